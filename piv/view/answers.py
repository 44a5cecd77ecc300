"""What the page asks for: fields, vortices, measures in areas and along lines, settings to try."""

import base64
import shlex
from dataclasses import asdict, replace
from typing import Any, get_args, get_type_hints

import cv2
import numpy as np
import xarray as xr
from numpy import ndarray

from piv.correlation.options import Options
from piv.correlation.pair import correlate_pair
from piv.fields.lines import along_line
from piv.fields.summary import summary
from piv.formats.plane_series import circulation_unit, fields_of, units_of, usable
from piv.images.calibration import Calibration, calibrate_plane
from piv.images.clock import interval_of
from piv.images.masks import inside_polygon, polygons_mask
from piv.images.preprocess import Preprocessor
from piv.sequence.frame_sets import SequenceOptions
from piv.view.session import Session, with_vorticity
from piv.vortices.contour import area, round_contour
from piv.vortices.find import find_vortices

FORM = (
    "window", "least_window", "spacing", "preset", "search", "threshold", "smoothing", "preprocess"
)  # fmt: skip
_PURPLE_ORANGE = "2d004b 542788 8073ac b2abd2 d8daeb f7f7f7 fee0b6 fdb863 e08214 b35806 7f3b08"


def about(session: Session, output: str) -> dict[str, Any]:
    """What the page knows of the whole session."""
    return {
        "name": session.name,
        "output": output,
        "count": session.count,
        "unit": session.unit,
        "extent": session.extent(),
        "images": session.recording is not None,
        "frames": len(session.recording) if session.recording is not None else session.count,
        "vectors": session.series is not None,
        "times": [session.time_text(k) for k in range(session.count)],
        "frame_of": [session.frame_number(k) for k in range(session.count)],
        "scales": _scales(session),
        "colours": _colours(),
        "form": _form(session),
    }


def _colours() -> dict[str, list[str]]:
    """64 colours of one sign (viridis) and of two (ColorBrewer's PuOr, blue negative)."""
    grey = np.linspace(0, 255, 64).astype(np.uint8)[:, None]
    one = cv2.applyColorMap(grey, cv2.COLORMAP_VIRIDIS)
    ends = np.linspace(0, 1, 11), np.array([list(bytes.fromhex(c)) for c in _PURPLE_ORANGE.split()])
    two = np.column_stack([np.interp(np.linspace(0, 1, 64), ends[0], c) for c in ends[1].T])
    maps = {"one": one[:, 0, ::-1], "two": np.rint(two).astype(np.uint8)}
    return {key: [f"#{bytes(c).hex()}" for c in colours] for key, colours in maps.items()}


def _scales(session: Session) -> dict[str, float]:
    """Limits of speed and vorticity that hold at every step: 99th percentiles of five."""
    if session.series is None:
        return {}
    found: dict[str, list[ndarray]] = {"speed": [], "vorticity": []}
    for k in np.unique(np.linspace(0, session.count - 1, 5).astype(int)):
        plane = session.plane(int(k))
        ok = usable(plane).values
        found["speed"].append(np.hypot(plane["u"].values, plane["v"].values)[ok])
        omega = np.abs(plane["vorticity"].values)
        found["vorticity"].append(omega[np.isfinite(omega)])
    whole = {n: np.concatenate(a) for n, a in found.items()}
    return {n: float(np.percentile(a, 99)) if a.size else 1.0 for n, a in whole.items()}


def _form(session: Session) -> list[dict[str, Any]]:
    """Settings to try: name, help and value."""
    return [
        {"name": name, "help": get_args(hint)[1], "value": getattr(made, name)}
        for made in session.made
        for name, hint in get_type_hints(type(made), include_extras=True).items()
        if name in FORM
    ]


def _chosen(session: Session, settings: dict[str, Any]) -> tuple[Options, SequenceOptions]:
    """The settings that the vectors were made with, some of them replaced."""
    options, sequence = session.made
    own = {k: settings[k] for k in settings if k != "preprocess"}
    preprocess = settings.get("preprocess", sequence.preprocess)
    return replace(options, **own), replace(sequence, preprocess=preprocess)


def proposal(session: Session, settings: dict[str, Any]) -> dict[str, str]:
    """`flags` of `piv correlate` for the settings, and a `note` on what a try leaves out."""
    options, sequence = _chosen(session, settings)
    note = ""
    if sequence.frames > 2 or sequence.ensemble:
        sets = "all pairs" if sequence.ensemble else f"{sequence.frames} frames"
        note = f"tried as a pair; a field of the file is of {sets}"
    if session.recording is not None and sequence.pairing == session.recording.pairing:
        sequence = replace(sequence, pairing=None)
    words = []
    for chosen in (options, sequence):
        default = asdict(type(chosen)())
        for name, value in asdict(chosen).items():
            flag = name.replace("_", "-")
            if value == default[name]:
                continue
            if isinstance(value, bool):
                words.append(f"--{flag}" if value else f"--no-{flag}")
            else:
                words += [f"--{flag}", str(value)]
    words += ["--mask", session.mask] if session.mask is not None else []
    return {"flags": shlex.join(words), "note": note}


def field(plane: xr.Dataset) -> dict[str, Any]:
    """A plane for the page: axes, and each field as base64 of float32, rows by ascending y."""
    ok = usable(plane).values
    data = {}
    for name in fields_of(plane):
        values = plane[name].transpose("y", "x").values.astype("<f4")
        if name not in ("valid", "flag"):
            values = np.where(ok, values, np.nan).astype("<f4")
        data[name] = base64.b64encode(values.tobytes()).decode()
    return {
        "x": plane["x"].values.tolist(),
        "y": plane["y"].values.tolist(),
        "data": data,
        "units": {n: str(plane[n].attrs.get("units", "")) for n in data},
        "summary": summary(plane),
    }


def vortices(plane: xr.Dataset) -> list[dict[str, float]]:
    """The finite numbers of each vortex, strongest first."""
    found = (asdict(w) for w in find_vortices(plane))
    return [{k: float(v) for k, v in w.items() if np.isfinite(v)} for w in found]


def inside(plane: xr.Dataset, polygon: list[list[float]]) -> dict[str, Any]:
    """Circulation round a polygon (counter-clockwise positive) and means over its vectors.

    The circulation is None where the line passes places without vectors.
    """
    corners = np.asarray(polygon, float)
    if len(corners) < 3:
        raise ValueError("an area needs at least 3 corners")
    x, y = plane["x"].values, plane["y"].values
    ok = usable(plane).transpose("y", "x").values
    round_ = round_contour(plane, corners)
    within = inside_polygon(corners, x, y) & ok
    means: dict[str, float | None] = {}
    for name in ("u", "v", "vorticity"):
        values = plane[name].transpose("y", "x").values[within]
        known = values[np.isfinite(values)]
        means[name] = float(known.mean()) if known.size else None
    result: dict[str, Any] = {
        "area": area(corners),
        "vectors": int(within.sum()),
        "mean": means,
        "circulation": round_.circulation if round_.lost == 0 else None,
        "unit": circulation_unit(units_of(plane)[0]),
        "lost": round_.lost,
    }
    if np.isfinite(round_.std):
        result["circulation_std"] = round_.std
    return result


def profile(plane: xr.Dataset, line: list[list[float]]) -> dict[str, Any]:
    """Velocity along and across a line (to its left) over the distance from its start."""
    (x0, y0), (x1, y1) = line
    found = along_line(plane, (x0, y0), (x1, y1))
    names = ("s", "along", "across", "vorticity")
    return {n: [None if np.isnan(v) else float(v) for v in found[n].values] for n in names}


def tried(
    session: Session, step: int, settings: dict[str, Any], polygons: list[list[list[float]]]
) -> xr.Dataset:
    """The vectors of the pair at a step with other settings and masks, in the session's units.

    `settings` replace those that the vectors of the session were made with.
    """
    if session.recording is None:
        raise ValueError("settings are tried on images; give --images RECORDING")
    options, sequence = _chosen(session, settings)
    first, second = session.frames_of(step)
    if first == second:
        raise ValueError("a pair needs two images, and --images has one; give more")
    clean = Preprocessor(sequence.steps, session.recording)
    masks = [clean.mask(session.recording.mask(k)) for k in (first, second)]
    if polygons:
        shapes = [np.asarray(p, float) for p in polygons]
        if session.unit != "px":
            pixel, origin = session.scale()
            shapes = [s / pixel + origin for s in shapes]
        drawn = polygons_mask(shapes, session.recording.shape)
        masks = [drawn if m is None else drawn | m for m in masks]
    a, b = (clean(session.recording.frame(k)) for k in (first, second))
    known = None if masks[0] is None and masks[1] is None else tuple(masks)
    plane = correlate_pair(a, b, mask=known, **asdict(options))
    if session.unit != "px":
        pixel, origin = session.scale()
        times = session.recording.times
        own = None if times is None else float(times[second] - times[first])
        stated = session.series.attrs.get("interval") if session.series is not None else None
        interval = interval_of(plane, stated if stated is not None else own)
        plane = calibrate_plane(plane, Calibration(pixel * 1e3, origin[0], origin[1]), interval)
    return with_vorticity(plane)
