"""`python -m docs.evidence.costs`: CPU hours of the parts of `make evidence`, before it runs.

Those of studies are the program's own estimates, from the last run of a stage where there is one.
The others were measured once, or are not known (?); ranks and the runs of stability are not listed.
"""

from pathlib import Path

from pipeline.runs.estimate import estimate
from pipeline.runs.run import run_of
from pipeline.runs.stages import until
from piv.files.errors import StageError
from softfinger.study.plan import describe
from softfinger.study.rows import read_study

STUDIES = (
    "validation/studies/validation.csv",
    "validation/studies/convergence.csv",
    "single_finger/studies/tradeoff.csv",
    "single_finger/studies/stability.csv",
    "single_finger/studies/drawn.csv",
    "single_finger/studies/coupling.csv",
    "pinch/studies/stability.csv",
    "pinch/studies/contact.csv",
    "pinch/studies/variations.csv",
)
# h, with date; None: not measured
OTHERS = {
    "bench-piv": None,
    "faults": None,
    "park": None,
    "laboratory, 40 seeds of 61 s (2026-11-27)": 0.7,
    "predictability": 0.5,
    "docs": 1.0,
}


def study_hours(path: Path) -> float:
    """CPU hours of a study's runs; equal stages count once, refused runs not at all."""
    home, seconds = path.parent.parent, dict[str, float]()
    for row in read_study(path):
        try:
            run = run_of(describe(home, path.stem, row))
            for stage in until(row.until):
                seconds[run.digest(stage.name)] = estimate(run, stage.name)[0]
        except StageError:
            continue
    return sum(seconds.values()) / 3600


def main() -> None:
    """Print the table and its sum."""
    studies = {name: study_hours(Path("cases") / name) for name in STUDIES}
    hours: dict[str, float | None] = {**studies, **OTHERS}
    for name, value in hours.items():
        print(f"{name:45s} {'?' if value is None else f'{value:.2f}':>6s} h")
    known = sum(value for value in hours.values() if value is not None)
    print(f"{'all that is known':45s} {known:6.2f} h of CPU, on two cores half of it")


if __name__ == "__main__":
    main()
