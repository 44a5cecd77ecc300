"""A synthetic pinch: tests/synthetic_stroke.py and its mirror image, with known PIV errors."""

from pathlib import Path

import numpy as np
import pandas as pd
import xarray as xr

from pipeline.formats.kinematics import read_kinematics, write_kinematics
from piv.formats.plane_series import FINGER_VARIABLES, make_plane, read_plane, write_plane
from tests.synthetic_stroke import SCENE as SINGLE
from tests.synthetic_stroke import write_case

GAIN = 0.99  # of the right vortex against the left one, in the PIV
SHIFT = 4e-4  # m: of the right vortex' centre upward, in the PIV
LEAST_GAP = 5e-4
SCENE = f"""
extends = "../single_finger"
title = "Two fingers pinch"
[pinch]
half_distance = 0.045
residual_gap = {LEAST_GAP}
slowing_distance = 0.003
[model]
kind = "quarter"
[motion]
strokes = [{{ pressure_kpa = 20.0, start = 0.0, duration = 0.4 }}]
"""


def mirrored(plane: xr.Dataset, at: float) -> xr.Dataset:
    """The part of a plane series left of the node x = `at`, shifted to x = 0 and mirrored."""
    x = plane["x"].values
    last = int(np.argmin(np.abs(x - at)))
    assert abs(x[last] - at) < 1e-9
    left = plane.isel(x=slice(0, last + 1)).load()

    def whole(name: str, odd: bool = False) -> np.ndarray:
        part = left[name].values.astype(float)
        if odd:
            part[..., -1] *= 0.0  # nothing crosses the plane; what is absent stays absent
        image = part[..., :-1][..., ::-1]
        return np.concatenate([part, -image if odd else image], axis=-1)

    def both(name: str) -> np.ndarray:
        values = left[name].values.copy()
        if name == "bend":
            return np.concatenate([values, values], axis=1)
        if name in ("outline", "tip"):
            values[..., 0] -= at
        return np.concatenate([values, values * [-1.0, 1.0]], axis=1)

    finger = {name: both(name) for name in FINGER_VARIABLES if name in left}
    axis = np.r_[x[: last + 1] - at, (at - x[:last])[::-1]]
    valid = whole("valid").astype(np.uint8)
    fields = {"u": whole("u", odd=True), "v": whole("v")}
    return make_plane(
        axis, left["y"].values, **fields, time=left["time"].values, valid=valid, **finger
    ).assign_attrs(plane.attrs)


def mirrored_vortices(table: pd.DataFrame, at: float, gain: float, shift: float) -> pd.DataFrame:
    """The tip vortex (track 3) and its mirror image (track 4) with a known error."""
    left = table[table["track"] == 3].assign(x=lambda t: t["x"] - at, finger=0)
    image = {"x": -left["x"], "y": left["y"] + shift, "finger": 1, "track": 4}
    right = left.assign(**image, circulation=-gain * left["circulation"])
    return pd.concat([left, right]).sort_values(["time", "track"], ignore_index=True)


def write_pinch(root: Path, **options) -> Path:
    """Write the stage files of the synthetic pinch below `root`; returns cases/pinch."""
    case = write_case(root, "pinch", bend_end=np.radians(80), **options)
    out = case / "out" / "coarse"
    (case / "scene.toml").write_text(SCENE)
    single = root / "cases" / "single_finger"
    single.mkdir(parents=True, exist_ok=True)
    (single / "scene.toml").write_text(SINGLE)
    with read_plane(out / "sheet.h5") as sheet:
        outline, step = sheet["outline"].values[:, 0], 2 * float(sheet["x"][1] - sheet["x"][0])
        reach = outline[..., 0].max(axis=1)
        at = float(sheet["x"][0]) + step * np.ceil((reach.max() - float(sheet["x"][0])) / step)
        time = sheet["time"].values
    for name, source, gain, shift in (("sheet", "cfd", 1.0, 0.0), ("piv", "piv", GAIN, SHIFT)):
        if not (out / f"{name}.h5").exists():
            continue
        with read_plane(out / f"{name}.h5") as plane:
            both = mirrored(plane, at)
        write_plane(both, out / f"{name}.h5")
        path = out / f"vortices_{source}.csv"
        table = pd.read_csv(path, comment="#")
        path.write_text(mirrored_vortices(table, at, gain, shift).to_csv(index=False))
    kinematics = read_kinematics(out / "kinematics.h5")
    attributes = ("source", "root", "length", "tip_thickness")
    values = {name: v.values for name, v in kinematics.data.variables.items()}
    values |= {name: kinematics.data.attrs[name] for name in attributes}
    gap, pressure = reach.max() - reach + LEAST_GAP, values["pressure"]
    values |= {"gap": gap, "free_pressure": 1.05 * pressure, "residual_gap": LEAST_GAP, "mirror": 1}
    values["shape_gap"] = np.interp(values["shape_parameter"], pressure, gap)
    write_kinematics(out / "kinematics.h5", values)
    assert values["time"].shape == time.shape
    return case
