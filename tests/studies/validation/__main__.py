"""`python -m tests.studies.validation`: the checks of docs/verification.md on the runs that are there; their results and the page."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path

from fileio.command import guarded
from fileio.errors import StageError
from pipeline.scene.scene import Scene
from tests.studies.validation import cylinders, deforming, exact_fields, finger, plates
from tests.studies.validation.checks import Result, write_result
from tests.studies.validation.ledger import DOCS, ORDER, write_ledger
from tests.studies.validation.solve import solved

ROOT = Path(__file__).resolve().parents[3]
FLOWS: dict[str, Callable[[Scene], Result]] = {
    "oscillating_cylinder": cylinders.oscillating,
    "impulsive_cylinder": cylinders.impulsive,
    "accelerating_cylinder": cylinders.accelerating,
    "plate_impulsive": plates.measure,
    "plate_medium_layer": plates.measure,
    "plate_thin_layer": plates.measure,
    "plate_accelerating": plates.measure,
}


def measure(name: str, again: bool) -> Result | None:
    """The result of one check by name; None where the runs that it reads are not there."""
    if name in FLOWS:
        return FLOWS[name](solved(name))
    others: dict[str, Callable[[], Result | None]] = {
        "deforming_mesh": partial(deforming.measure, again),
        "exact_fields": exact_fields.measure,
        "finger_2d": finger.two_dimensional,
        "finger": partial(finger.three_dimensional, ROOT / "cases" / "single_finger"),
    }
    return others[name]()


def run(names: list[str], quiet: bool, again: bool) -> None:
    """Measure, write one results file per name, then the page."""
    for name in names:
        result = measure(name, again)
        if result is None:
            print(f"{name}: fewer than three grids have been run; make convergence runs them")
            continue
        write_result(result, DOCS / "verification" / f"{name}.json")
        if not quiet:
            missed = [c.id for c in result.checks if not c.met]
            print(
                f"{name}: {len(result.checks)} checks, missed: {', '.join(missed) or 'none'}",
                flush=True,
            )
    missed_in_all = write_ledger()
    if not quiet:
        print(f"docs/verification.md: {missed_in_all} checks missed")


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(prog="python -m tests.studies.validation", description=__doc__)
    parser.add_argument(
        "names", nargs="*", metavar="NAME", help=f"checks to run (default: all): {', '.join(ORDER)}"
    )
    parser.add_argument(
        "--again",
        action="store_true",
        help="solve deforming_mesh again, which has a solver of its own",
    )
    parser.add_argument(
        "--page", action="store_true", help="only write the page from the results that are there"
    )
    parser.add_argument("--quiet", action="store_true", help="print nothing but errors")
    args = parser.parse_args()

    def action() -> None:
        unknown = set(args.names) - set(ORDER)
        if unknown:
            raise StageError(
                f"{', '.join(sorted(unknown))}: no such check; there are {', '.join(ORDER)}"
            )
        run([] if args.page else args.names or list(ORDER), args.quiet, args.again)

    sys.exit(guarded("validation", action))


if __name__ == "__main__":
    main()
