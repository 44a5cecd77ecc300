"""Bands of force and circulation: coupled runs tell what rubber and damping change of them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from pipeline.formats.records import FORCES
from pipeline.runs.run import Run
from postprocess.evidence import tip_vortex as tracks
from postprocess.evidence.stage_files import StageFiles
from postprocess.report.trust import measured_errors
from softfinger.study.table import middle_of_stroke
from softfinger.twin.confirm import coupled
from softfinger.twin.fit import BAND, Fit
from softfinger.twin.identify import GROUPS
from softfinger.twin.model import LOADS, LOSS, STIFF, Stroke, Twin

GRID = "grid and step"
_CHANGED = {STIFF: "stiffness", LOADS: "loads", LOSS: "damping"}  # names of the runs
LAST = "vortices_cfd"  # stage that a run needs
# of the prior's standard deviation, by which a run's parameter is changed: a smaller change is
# lost in what the vortex's place on the grid does to its circulation
_LEAST_STEP = 0.2
_FORCE, _CIRCULATION = "largest force, N", "mean circulation of the tip vortex, m²/s"
_ERRORS = {_FORCE: "error_force", _CIRCULATION: "error_circulation"}


def flow_bands(
    twin: Twin, found: Fit, folder: Path, level: str, stroke: Stroke, base: Run
) -> list[dict[str, Any]]:
    """Value, band (95 %) and shares by group of each number of the flow, by three coupled runs.

    `base`: the run of `found` itself. The error that the level had in the trade-off's study, where
    its scene has one, counts as a standard uncertainty. Where one of the runs has no vortex the
    circulation is left out.
    """
    window = middle_of_stroke(StageFiles(base.scene))
    own, changed = _numbers(base, window), []
    for k, name in zip(_places(found), _CHANGED.values(), strict=True):
        step = max(float(found.std[k]), _LEAST_STEP)
        values = found.values(found.z + step * np.eye(len(found.z))[k])
        run, _ = coupled(twin, folder, level, stroke, name, values, LAST)
        changed.append((step, _numbers(run, window)))
    errors = measured_errors([base.scene.folder, *base.scene.parents], level)
    rows = []
    for name, value in own.items():
        if all(name in other for _, other in changed):
            slopes = np.array([(other[name] - value) / step for step, other in changed])
            rows.append({"name": name} | band(value, slopes, found, errors.get(_ERRORS[name])))
    return rows


def band(value: float, slopes: np.ndarray, found: Fit, error: float | None) -> dict[str, Any]:
    """Band of a value with `slopes` by the changed parameters, per standard deviation of the prior.

    `error`: relative, of the level; None where none was measured, which leaves its share out.
    """
    places = _places(found)
    covariance = found.covariance[np.ix_(places, places)]
    parts = dict(zip(_CHANGED, slopes * (covariance @ slopes), strict=True))
    groups = {group: of for group, of in GROUPS.items() if parts.keys() >= set(of)}
    shares = {group: float(sum(parts[n] for n in of)) for group, of in groups.items()}
    if error is not None:
        shares[GRID] = (error * value) ** 2
    total = max(sum(shares.values()), 1e-300)
    half = BAND * total**0.5
    relative = {group: part / total for group, part in shares.items()}
    return {"value": value, "band": [value - half, value + half], "shares": relative}


def _places(found: Fit) -> list[int]:
    """Positions of the changed parameters among those of the fit."""
    names = [one.name for one in found.parameters]
    return [names.index(name) for name in _CHANGED]


def _numbers(run: Run, window: tuple[float, float]) -> dict[str, float]:
    """The flow's numbers of a run: over its whole stroke, or over a `window` (s)."""
    out = run.scene.out
    force = FORCES.read(out / "run" / "forces.csv")
    table: dict[str, pd.DataFrame] = {"cfd": tracks.read_vortices(out / f"{LAST}.csv")}
    means = tracks.common_means(tracks.dominant_tracks(table, 0, window), window)
    found = {_FORCE: float(np.hypot(force["fx"], force["fy"]).max())}
    if "cfd" in means:
        found[_CIRCULATION] = abs(means["cfd"]["circulation"])
    return found
