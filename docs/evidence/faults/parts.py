"""The parts of `make faults`, and the rows of its table that each replaces."""

from collections.abc import Callable, Iterator
from itertools import chain

import numpy as np
import pandas as pd

from docs.evidence.faults.campaign import TARGETS, Campaign, Row, kills, twice
from docs.evidence.faults.files import damaged, disks, foreign
from docs.evidence.faults.project import difference, small_run
from pipeline.runs.run import targets

COUPLED_RUN = "solve, coupled"


def odd_paths(at: Campaign) -> Iterator[Row]:
    """Folders whose names OpenFOAM, or a console, cannot write."""
    for fault, name in (
        ("letters beyond ASCII in the path", "Größe-測定"),
        ("spaces and quotes in the path", "o'brien's \"lab\""),
    ):
        run = small_run(at.folder / name / "small")
        answer = at.make("sheet", run).answer()
        wrong = "" if answer[0] == 0 else f"ended with {answer[0]}"
        yield at.row("sheet", fault, [answer], wrong or difference(at.wanted, run.out, ["sheet"]))


def of_kills(at: Campaign, chosen: list[str], count: int, seed: int) -> Iterator[Row]:
    """Kill each target, a coupled run too, and make each twice at once."""
    for target in chosen:
        yield kills(at, target, count, seed)
        yield twice(at, target)
    if "solve" in chosen:
        coupled = Campaign(at.folder / "coupled", "solve", coupled=True)
        yield kills(coupled, "solve", 2 * count, seed) | {"stage": COUPLED_RUN}


PARTS: dict[str, tuple[str, Callable[[Campaign, list[str], int, int], Iterator[Row]]]] = {
    "kills": ("killed|two makes at once", of_kills),
    "paths": (".* in the path", lambda at, *_: odd_paths(at)),
    "disks": ("disk .*", lambda at, chosen, *_: disks(at, chosen)),
    "damaged": ("damaged .*", lambda at, chosen, *_: chain(*(damaged(at, t) for t in chosen))),
    "foreign": (".* of another .*", lambda at, chosen, *_: foreign(at, chosen)),
}


def replaced(old: pd.DataFrame, parts: list[str], chosen: list[str]) -> pd.DataFrame:
    """The rows of an earlier table that these parts on these targets do not make anew."""
    stages = {stage for target in TARGETS for stage in (target, *targets(target))}
    anew = {stage for target in chosen for stage in (target, *targets(target))}
    anew |= {COUPLED_RUN} if "solve" in chosen else set()
    fault, stage = old["fault"], old["stage"]
    made = [fault.str.fullmatch(PARTS[part][0]) & (stage.isin(anew) | (part == "paths"))
            for part in parts]  # fmt: skip
    return old[stage.isin(stages | {COUPLED_RUN}) & ~np.logical_or.reduce(made)]
