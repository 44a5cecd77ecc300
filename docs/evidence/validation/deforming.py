"""Two vortices of closed form and a uniform stream on a mesh that is deformed through them."""

import json
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from docs.evidence.validation.checks import Check, Result
from docs.evidence.validation.solve import CASES, cpu_seconds
from docs.evidence.validation.transparent import Cells, Field, at_end, solve_transparent
from pipeline.openfoam.environment import foam_version
from pipeline.runs.run import Run, open_run
from pipeline.scene.scene import Scene, load_scene
from piv.files.atomic import write_text

NAME = "deforming_mesh"
SPACE = ("h32", "h48", "h64")
COARSER = ("h32", "h48")
TIME = ("dt200", "dt100", "dt050", "dt025")
STREAM = (0.3, 0.1)
ITERATED = 4  # outer correctors after which nothing lags behind
CORE_SQUARED = 0.016  # m², of Lamb and Oseen's vortex at the start: a core of 0.126 m
PEAK = 1.0  # m/s at the start
SWIRL = 0.6381727  # max of (1 − exp(−s²)) / s


@dataclass(frozen=True)
class Flow:
    """A solution of closed form: velocity for a viscosity (m²/s), type of U on the outer sides."""

    name: str
    field: Callable[[float], Field]
    boundary: str


def _lamb_oseen(viscosity: float) -> Field:
    """A diffusing vortex in the box: Γ/(2πr) (1 − exp(−r²/r_c²)), r_c² = CORE_SQUARED + 4νt."""
    strength = PEAK * np.sqrt(CORE_SQUARED) / SWIRL  # Γ / 2π

    def field(position: np.ndarray, time: float) -> np.ndarray:
        x, y = position[:, 0], position[:, 1] - 0.5
        square, core = x**2 + y**2, CORE_SQUARED + 4 * viscosity * time
        near = square < 1e-12 * core
        outside = -np.expm1(-square / core) / np.where(near, 1.0, square)
        turning = strength * np.where(near, 1 / core, outside)
        return np.column_stack([-turning * y, turning * x])

    return field


def _taylor_green(viscosity: float) -> Field:
    """u = sin πx cos πy, v = −cos πx sin πy over a unit box, decaying; x from the left wall."""

    def field(position: np.ndarray, time: float) -> np.ndarray:
        x, y = np.pi * (position[:, 0] + 0.5), np.pi * position[:, 1]
        decay = np.exp(-2 * viscosity * np.pi**2 * time)
        return decay * np.column_stack([np.sin(x) * np.cos(y), -np.cos(x) * np.sin(y)])

    return field


# The first is steady on the walls to 1e-5 of its peak: its values can be prescribed there.
LAMB_OSEEN = Flow("lamb_oseen", _lamb_oseen, "fixedValue")
TAYLOR_GREEN = Flow("taylor_green", _taylor_green, "slip")


def _variant(folder: Path, level: str, tag: str, **numerics: int | str) -> Run:
    """The run at a level with other numerics, in a folder of its own."""
    overrides = {f"numerics.{key}": value for key, value in numerics.items()}
    return open_run(folder / NAME, level, overrides, folder / NAME / "out" / f"{level}_{tag}")


def _vortex_cells(
    flow: Flow, level: str, again: bool, folder: Path, outer: int, interpolation: str = "linear"
) -> tuple[Scene, Cells]:
    """The vortex at the end of a run, which is solved unless it is there for these numbers."""
    tag = f"{flow.name}_{outer}_{interpolation}"
    run = _variant(folder, level, tag, outer_correctors=outer, interpolation=interpolation)
    scene, wanted = run.scene, run.digest("case")
    stamp = scene.out / "transparent.json"
    if again or not stamp.exists() or json.loads(stamp.read_text()) != wanted:
        solve_transparent(scene, flow.field(scene.fluid.kinematic_viscosity), flow.boundary)
        write_text(stamp, json.dumps(wanted))
    return scene, at_end(scene)


def _rms(difference: np.ndarray, areas: np.ndarray) -> float:
    """Root mean square over the area of vectors (cell, 2)."""
    return float(np.sqrt((difference**2).sum(1) @ areas / areas.sum()))


def order_of(size: np.ndarray, error: np.ndarray) -> float:
    """Slope of log error over log size."""
    return float(np.polyfit(np.log(size), np.log(error), 1)[0])


def space_errors(
    flow: Flow,
    levels: tuple[str, ...],
    again: bool = False,
    folder: Path = CASES,
    outer: int = ITERATED,
    interpolation: str = "linear",
) -> tuple[np.ndarray, np.ndarray]:
    """Mean cell size (m) and rms error (m/s) of each level."""
    size, error = [], []
    for level in levels:
        scene, cells = _vortex_cells(flow, level, again, folder, outer, interpolation)
        exact = flow.field(scene.fluid.kinematic_viscosity)(cells.centres, scene.motion.end_time)
        size.append(1 / np.sqrt(len(cells.areas)))
        error.append(_rms(cells.velocity - exact, cells.areas))
    return np.array(size), np.array(error)


def _time_differences(outer: int, again: bool) -> tuple[np.ndarray, np.ndarray]:
    """Time steps (s) and rms difference (m/s) of each from the next smaller, on the same mesh."""
    runs = [_vortex_cells(LAMB_OSEEN, level, again, CASES, outer) for level in TIME]
    step = np.array([scene.numerics.time_step for scene, _ in runs])
    gaps = [_rms(a.velocity - b.velocity, a.areas) for (_, a), (_, b) in pairwise(runs)]
    return step[:-1], np.array(gaps)


def _stream_error(level: str) -> float:
    """Largest difference from a uniform stream at the end, relative to it."""
    scene = _variant(CASES, level, "stream", outer_correctors=1).scene
    solve_transparent(scene, lambda place, _: np.tile(STREAM, (len(place), 1)), "fixedValue")
    return float(np.abs(at_end(scene).velocity - STREAM).max() / np.hypot(*STREAM))


def measure(again: bool = False) -> Result:
    """Orders in space and time, and the uniform stream.

    A circle of 0.3 m swings by 0.15 m through the middle of a box of 1 m. It is transparent, so
    that nothing but the mesh moves. Schemes are those of the scenes, linear solvers go to 1e-11.
    """
    before = cpu_seconds()
    scene = load_scene(CASES / NAME, SPACE[-1])
    size, error = space_errors(LAMB_OSEEN, SPACE, again)
    wall_size, wall_error = space_errors(TAYLOR_GREEN, COARSER, again)
    _, corrected = space_errors(LAMB_OSEEN, COARSER, again, interpolation="skewCorrected")
    step, iterated = _time_differences(ITERATED, again)
    _, twice = _time_differences(2, again)
    _, once = _time_differences(1, again)
    scheme = "absolute", 2.0, "the scheme"
    rows: tuple[tuple[Any, ...], ...] = (
        ("space", "order in space, rms velocity error of Lamb and Oseen's vortex",
         order_of(size, error), 0.2, ("absolute", 2.0, "exact solution"),
         "a bound: half the cell still divides the error by 3.5 at least"),
        ("walls", "the same of Taylor and Green's vortex, which slips along walls of triangles",
         order_of(wall_size, wall_error), 0.9, ("at least", None, ""),
         "a zero gradient is taken from the middle of a triangle, not from above the face:"
         " first order beside such walls"),
        ("time", f"order in time, backward, {ITERATED} outer correctors",
         order_of(step, iterated), 0.2, scheme,
         "the scheme's order; successive time steps on the same mesh"),
        ("time_twice", "order in time with two outer correctors", order_of(step, twice), 0.3,
         scheme, "one iteration takes the lag out to the scheme's order"),
        ("time_once", "order in time with one outer corrector, as the scenes use",
         order_of(step[-2:], once[-2:]), 0.3, ("absolute", 1.0, "the scheme"),
         "convecting flux, predictor and explicit corrections lag a step behind: first order"),
        ("stream", "uniform stream: largest relative change", _stream_error("h24"), 1e-8,
         ("at most", None, "exact invariant"), "linear solvers' tolerance 1e-11 over 120 steps"),
    )  # fmt: skip
    checks = tuple(
        Check(f"deforming.{name}", quantity, result, tolerance, how, why, wanted, source)
        for name, quantity, result, tolerance, (how, wanted, source), why in rows
    )
    curves = {
        "size": size, "error": error, "wall_size": wall_size, "wall_error": wall_error,
        "corrected": corrected, "step": step, "iterated": iterated, "twice": twice, "once": once,
    }  # fmt: skip
    spent = {"cpu_seconds": round(cpu_seconds() - before, 1)}
    origin = {"versions": {"OpenFOAM": foam_version()}, **spent}
    lists = {name: values.tolist() for name, values in curves.items()}
    return Result(NAME, scene.title, checks, lists, origin)
