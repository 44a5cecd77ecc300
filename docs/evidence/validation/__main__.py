"""`python -m docs.evidence.validation`: the checks of docs/verification.md, tables and figures."""

import argparse
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path

from docs.evidence.validation import (
    cantilever,
    cylinders,
    deforming,
    finger,
    luhar_nepf,
    plates,
    ringdown,
    shedding,
    sprung,
    turek_hron,
)
from docs.evidence.validation.checks import Result, write_result
from docs.evidence.validation.ledger import FOLDER, ORDER, write_ledger
from docs.evidence.validation.solve import solved
from piv.files.command import guarded

LONG = (turek_hron.FLUTTER, luhar_nepf.NAME)  # their runs take hours: by their names alone
FINGER = Path(__file__).resolve().parents[3] / "cases" / "single_finger"
CYLINDERS = {
    "oscillating_cylinder": cylinders.oscillating,
    "impulsive_cylinder": cylinders.impulsive,
    "accelerating_cylinder": cylinders.accelerating,
    "cylinder_in_current": shedding.measure,
}


def measure(name: str, again: bool) -> Result | None:
    """The result of one check by name; None where the runs that it reads are not there."""
    others: dict[str, Callable[[], Result | None]] = {
        "deforming_mesh": partial(deforming.measure, again),
        sprung.NAME: sprung.measure,
        ringdown.NAME: ringdown.measure,
        cantilever.NAME: cantilever.measure,
        turek_hron.NAME: partial(turek_hron.measure, turek_hron.NAME),
        turek_hron.FLUTTER: partial(turek_hron.measure, turek_hron.FLUTTER),
        luhar_nepf.NAME: luhar_nepf.measure,
        "finger_2d": finger.two_dimensional,
        "finger": partial(finger.three_dimensional, FINGER),
    }
    if name in others:
        return others[name]()
    return CYLINDERS.get(name, plates.measure)(solved(name))


def run(names: list[str], quiet: bool, again: bool) -> None:
    """Measure, write one results file per name, then the tables."""
    for name in names:
        result = measure(name, again)
        if result is None:
            why = "fewer than three grids have been run; make validate runs them"
            if name == ringdown.NAME:
                why = "the recordings of shared/data/silicone_ringdown are not there"
            print(f"{name}: {why}")
            continue
        write_result(result, FOLDER / f"{name}.json")
        if not quiet:
            missed = ", ".join(c.id for c in result.checks if not c.met) or "none"
            print(f"{name}: {len(result.checks)} checks, missed: {missed}", flush=True)
    missed_in_all = write_ledger()
    if not quiet:
        print(f"docs/verification.md: {missed_in_all} checks missed")


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(prog="python -m docs.evidence.validation", description=__doc__)
    names = f"checks to run (default: all but {' and '.join(LONG)}): {', '.join(ORDER)}"
    parser.add_argument("names", nargs="*", metavar="NAME", help=names)
    parser.add_argument("--again", action="store_true", help="solve deforming_mesh again")
    parser.add_argument("--page", action="store_true", help="only tables and figures")
    parser.add_argument("--quiet", action="store_true", help="print nothing but errors")
    args = parser.parse_args()
    if unknown := set(args.names) - set(ORDER):
        parser.error(f"{', '.join(sorted(unknown))}: no such check")

    def action() -> None:
        every = [name for name in ORDER if name not in LONG]
        run([] if args.page else args.names or every, args.quiet, args.again)

    sys.exit(guarded("validation", action))


if __name__ == "__main__":
    main()
