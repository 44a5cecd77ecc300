"""Two vortices of closed form and a uniform stream on a mesh that is deformed through them."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np

from fileio.atomic import write_text
from pipeline.openfoam.base_case import templates_digest
from pipeline.openfoam.environment import foam_version
from pipeline.scene.scene import Scene, load_scene
from tests.studies.validation.checks import Check, Result
from tests.studies.validation.solve import CASES, cpu_seconds
from tests.studies.validation.transparent import Cells, Field, at_end, solve_transparent

NAME = "deforming_mesh"
SPACE = ("h32", "h48", "h64")
COARSER = ("h32", "h48")
TIME = ("dt200", "dt100", "dt050", "dt025")
STREAM = (0.3, 0.1)
ITERATED = 4  # outer correctors with which nothing lags behind
CORE_SQUARED = 0.016  # m², of Lamb and Oseen's vortex at the start: a core of 0.126 m
PEAK = 1.0  # m/s at the start
SWIRL = 0.6381727  # max of (1 − exp(−s²)) / s


@dataclass(frozen=True)
class Flow:
    """A solution of closed form: its velocity for a viscosity (m²/s), and what U is on the outer sides."""

    name: str
    field: Callable[[float], Field]
    boundary: str


def lamb_oseen(viscosity: float) -> Field:
    """A diffusing vortex in the middle of the box, Γ/(2πr) (1 − exp(−r²/r_c²)), r_c² = CORE_SQUARED + 4νt."""
    strength = PEAK * np.sqrt(CORE_SQUARED) / SWIRL  # Γ / 2π

    def field(position: np.ndarray, time: float) -> np.ndarray:
        x, y = position[:, 0], position[:, 1] - 0.5
        square, core = x**2 + y**2, CORE_SQUARED + 4 * viscosity * time
        near = square < 1e-12 * core
        turning = strength * np.where(
            near, 1 / core, -np.expm1(-square / core) / np.where(near, 1.0, square)
        )
        return np.column_stack([-turning * y, turning * x])

    return field


def taylor_green(viscosity: float) -> Field:
    """u = sin πx cos πy, v = −cos πx sin πy over a unit box, decaying; x from the left wall."""

    def field(position: np.ndarray, time: float) -> np.ndarray:
        x, y = np.pi * (position[:, 0] + 0.5), np.pi * position[:, 1]
        decay = np.exp(-2 * viscosity * np.pi**2 * time)
        return decay * np.column_stack([np.sin(x) * np.cos(y), -np.cos(x) * np.sin(y)])

    return field


def uniform(position: np.ndarray, time: float) -> np.ndarray:
    """The same velocity everywhere."""
    return np.tile(STREAM, (len(position), 1))


# On the walls the first is steady to 1e-5 of the peak, so that its values there can be given; the second slips along them.
LAMB_OSEEN = Flow("lamb_oseen", lamb_oseen, "fixedValue")
TAYLOR_GREEN = Flow("taylor_green", taylor_green, "slip")


def variant(scene: Scene, tag: str, **numerics: int | str) -> Scene:
    """The scene with other numerics, in a folder of its own."""
    changed = scene.numerics.model_copy(update=numerics)
    return scene.model_copy(update={"numerics": changed, "level": f"{scene.level}_{tag}"})


def vortex_cells(
    flow: Flow,
    level: str,
    again: bool,
    folder: Path = CASES,
    outer: int = ITERATED,
    interpolation: str = "linear",
) -> tuple[Scene, Cells]:
    """The vortex at the end of a run, solved unless that was done for these very numbers."""
    scene = variant(load_scene(folder / NAME, level), f"{flow.name}_{outer}_{interpolation}",
                    outer_correctors=outer, interpolation=interpolation)  # fmt: skip
    stamp = scene.out / "transparent.json"
    wanted = {"scene_hash": scene.digest(), "templates": templates_digest()}
    if again or not stamp.exists() or json.loads(stamp.read_text()) != wanted:
        solve_transparent(scene, flow.field(scene.fluid.kinematic_viscosity), flow.boundary)
        write_text(stamp, json.dumps(wanted))
    return scene, at_end(scene)


def rms(difference: np.ndarray, areas: np.ndarray) -> float:
    """Root mean square over the area of vectors (cell, 2)."""
    return float(np.sqrt((difference**2).sum(1) @ areas / areas.sum()))


def order_of(size: np.ndarray, error: np.ndarray) -> float:
    """Slope of log error over log size."""
    return float(np.polyfit(np.log(size), np.log(error), 1)[0])


def space_errors(
    flow: Flow, levels: tuple[str, ...], again: bool = False, folder: Path = CASES, outer: int = ITERATED,
    interpolation: str = "linear",
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """Mean cell size (m) and rms error (m/s) of each level."""
    size, error = [], []
    for level in levels:
        scene, cells = vortex_cells(flow, level, again, folder, outer, interpolation)
        exact = flow.field(scene.fluid.kinematic_viscosity)(cells.centres, scene.motion.end_time)
        size.append(1 / np.sqrt(len(cells.areas)))
        error.append(rms(cells.velocity - exact, cells.areas))
    return np.array(size), np.array(error)


def time_differences(
    levels: tuple[str, ...], outer: int, again: bool = False
) -> tuple[np.ndarray, np.ndarray]:
    """Time steps (s) and rms difference (m/s) of each from the next smaller one, on the same mesh."""
    runs = [vortex_cells(LAMB_OSEEN, level, again, outer=outer) for level in levels]
    step = np.array([scene.numerics.time_step for scene, _ in runs])
    gaps = [rms(a.velocity - b.velocity, a.areas) for (_, a), (_, b) in pairwise(runs)]
    return step[:-1], np.array(gaps)


def stream_error(level: str) -> float:
    """Largest difference from a uniform stream at the end, relative to it."""
    scene = variant(load_scene(CASES / NAME, level), "stream", outer_correctors=1)
    solve_transparent(scene, uniform, "fixedValue")
    return float(np.abs(at_end(scene).velocity - STREAM).max() / np.hypot(*STREAM))


def measure(again: bool = False) -> Result:
    """Orders in space and time, and the uniform stream."""
    before = cpu_seconds()
    scene = load_scene(CASES / NAME, SPACE[-1])
    size, error = space_errors(LAMB_OSEEN, SPACE, again=again)
    wall_size, wall_error = space_errors(TAYLOR_GREEN, COARSER, again=again)
    _, corrected = space_errors(LAMB_OSEEN, COARSER, again=again, interpolation="skewCorrected")
    step, iterated = time_differences(TIME, ITERATED, again)
    _, twice = time_differences(TIME, 2, again)
    _, once = time_differences(TIME, 1, again)
    bound, steps = (
        "a bound: half the cell still divides the error by 3.5 at least",
        "the scheme's order; successive time steps on the same mesh",
    )
    checks = (
        Check("deforming.space", "order in space, rms velocity error of Lamb and Oseen's vortex", order_of(size, error), 0.2,
              "absolute", bound, 2.0, "exact solution"),
        Check("deforming.walls", "the same of Taylor and Green's vortex, which slips along walls of triangles",
              order_of(wall_size, wall_error), 0.9, "at least",
              "a zero gradient is taken from the middle of a triangle, not from above the face: first order beside such walls"),
        Check("deforming.time", f"order in time, backward, {ITERATED} outer correctors", order_of(step, iterated), 0.2, "absolute",
              steps, 2.0, "the scheme"),
        Check("deforming.time_twice", "order in time with two outer correctors", order_of(step, twice), 0.3, "absolute",
              "one iteration takes the lag out to the scheme's order", 2.0, "the scheme"),
        Check("deforming.time_once", "order in time with one outer corrector, as the scenes use", order_of(step[-2:], once[-2:]),
              0.3, "absolute", "convecting flux, predictor and explicit corrections lag a step behind: first order", 1.0, "the scheme"),
        Check("deforming.stream", "uniform stream: largest relative change", stream_error("h24"), 1e-8, "at most",
              "linear solvers' tolerance 1e-11 over 120 steps", None, "exact invariant"),
    )  # fmt: skip
    curves = {
        "size": size.tolist(), "error": error.tolist(), "wall_size": wall_size.tolist(), "wall_error": wall_error.tolist(),
        "corrected": corrected.tolist(), "step": step.tolist(), "iterated": iterated.tolist(), "twice": twice.tolist(), "once": once.tolist(),
    }  # fmt: skip
    remarks = (
        'With `numerics.interpolation = "skewCorrected"` (docs/schemes.md) the error is'
        f" {corrected[0] / error[0]:.2f} and {corrected[1] / error[1]:.2f} of that on the first two meshes.",
        f"Between steps of {step[-1]:g} and {step[-1] / 2:g} s the velocity changes by {once[-1]:.1e} of the vortex's peak with one"
        f" outer corrector, by {twice[-1]:.1e} with two and by {iterated[-1]:.1e} with {ITERATED}.",
        "With one outer corrector the convecting flux, the predictor's pressure and the explicit corrections are a step old;"
        " OpenFOAM extrapolates none of them (docs/schemes.md, Time).",
    )
    text = (
        "A circle of 0.3 m swings by 0.15 m through the middle of a box of 1 m and deforms the mesh; it is transparent, so that"
        " nothing but the mesh moves. In the middle lies Lamb and Oseen's vortex (core 0.126 m, peak 1 m/s, ν = 0.005 m²/s);"
        " for comparison the box holds one cell of Taylor and Green's. Mesh, motion, solver and schemes are those of the scenes;"
        " linear solvers to 1e-11. In space: 120 steps, cells 1/32 … 1/64 (4 … 8 to a core)."
    )
    spent = {"cpu_seconds": round(cpu_seconds() - before, 1)}
    origin = {"versions": {"OpenFOAM": foam_version()}, "scene_hash": scene.digest(), **spent}
    return Result(NAME, scene.title, text, checks, curves, remarks, origin)
