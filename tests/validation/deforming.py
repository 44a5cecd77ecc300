"""A Taylor-Green vortex and a uniform stream on a mesh that is deformed through them."""

from __future__ import annotations

import json
from itertools import pairwise
from pathlib import Path

import numpy as np

from pipeline.openfoam import foam_version
from pipeline.scene import Scene, load_scene
from pipeline.stage import write_text
from tests.validation.checks import Check, Result
from tests.validation.solve import CASES, cpu_seconds
from tests.validation.transparent import Cells, at_end, solve_transparent

NAME = "deforming_mesh"
SPACE = ("h16", "h24", "h32", "h48")
TIME = ("dt200", "dt100", "dt050", "dt025")
STREAM = (0.3, 0.1)
ITERATED = 8  # outer correctors with which nothing lags behind: more change the result by less than 1e-6


def taylor_green(viscosity: float):
    """u = sin πx cos πy, v = −cos πx sin πy over a unit box, decaying; x from the left wall."""

    def field(position: np.ndarray, time: float) -> np.ndarray:
        x, y = np.pi * (position[:, 0] + 0.5), np.pi * position[:, 1]
        decay = np.exp(-2 * viscosity * np.pi**2 * time)
        return decay * np.column_stack([np.sin(x) * np.cos(y), -np.cos(x) * np.sin(y)])

    return field


def uniform(position: np.ndarray, time: float) -> np.ndarray:
    """The same velocity everywhere."""
    return np.tile(STREAM, (len(position), 1))


def with_outer(scene: Scene, outer: int, tag: str) -> Scene:
    """The scene with another number of outer correctors, in a folder of its own."""
    numerics = scene.numerics.model_copy(update={"outer_correctors": outer})
    return scene.model_copy(update={"numerics": numerics, "level": f"{scene.level}_{tag}"})


def vortex_cells(scene: Scene, again: bool = False) -> Cells:
    """The vortex at the end of a run, solved unless that was done for these very numbers."""
    stamp = scene.out / "transparent.json"
    wanted = {"scene_hash": scene.digest()}
    if again or not stamp.exists() or json.loads(stamp.read_text()) != wanted:
        solve_transparent(scene, taylor_green(scene.fluid.kinematic_viscosity), "slip")
        write_text(stamp, json.dumps(wanted))
    return at_end(scene)


def rms(difference: np.ndarray, areas: np.ndarray) -> float:
    """Root mean square over the area of vectors (cell, 2)."""
    return float(np.sqrt((difference**2).sum(1) @ areas / areas.sum()))


def order_of(size: np.ndarray, error: np.ndarray) -> float:
    """Slope of log error over log size."""
    return float(np.polyfit(np.log(size), np.log(error), 1)[0])


def space_errors(
    levels: tuple[str, ...], outer: int = ITERATED, again: bool = False, folder: Path = CASES
) -> tuple[np.ndarray, np.ndarray]:
    """Mean cell size (m) and rms error (m/s) of each level."""
    size, error = [], []
    for level in levels:
        scene = with_outer(load_scene(folder / NAME, level), outer, f"o{outer}")
        cells = vortex_cells(scene, again)
        exact = taylor_green(scene.fluid.kinematic_viscosity)(cells.centres, scene.motion.end_time)
        size.append(1 / np.sqrt(len(cells.areas)))
        error.append(rms(cells.velocity - exact, cells.areas))
    return np.array(size), np.array(error)


def time_differences(
    levels: tuple[str, ...], outer: int, again: bool = False
) -> tuple[np.ndarray, np.ndarray]:
    """Time steps (s) and rms difference (m/s) of each from the next smaller one, on the same mesh."""
    scenes = [with_outer(load_scene(CASES / NAME, level), outer, f"o{outer}") for level in levels]
    cells = [vortex_cells(scene, again) for scene in scenes]
    step = np.array([scene.numerics.time_step for scene in scenes])
    gaps = [rms(a.velocity - b.velocity, a.areas) for a, b in pairwise(cells)]
    return step[:-1], np.array(gaps)


def stream_error(level: str) -> float:
    """Largest difference from a uniform stream at the end, relative to it."""
    scene = with_outer(load_scene(CASES / NAME, level), 1, "stream")
    solve_transparent(scene, uniform, "fixedValue")
    return float(np.abs(at_end(scene).velocity - STREAM).max() / np.hypot(*STREAM))


def measure(again: bool = False) -> Result:
    """Orders in space and time, and the uniform stream."""
    before = cpu_seconds()
    scene = load_scene(CASES / NAME, SPACE[2])
    size, error = space_errors(SPACE, again=again)
    step, iterated = time_differences(TIME, ITERATED, again)
    _, once = time_differences(TIME, 1, again)
    why = "the issue's target"
    checks = (
        Check("deforming.space", "order in space, rms velocity error of the vortex", order_of(size, error), 0.2, "absolute",
              why, 2.0, "exact solution"),
        Check("deforming.time", f"order in time, backward, {ITERATED} outer correctors", order_of(step, iterated), 0.2, "absolute",
              "the scheme's order; successive time steps on the same mesh", 2.0, "the scheme"),
        Check("deforming.time_once", "order in time with one outer corrector, as the scenes use", order_of(step[-2:], once[-2:]),
              0.3, "absolute", "convecting flux and explicit corrections lag a step behind: first order", 1.0, "the scheme"),
        Check("deforming.stream", "uniform stream: largest relative change", stream_error("h24"), 1e-8, "at most",
              "linear solvers' tolerance 1e-11 over 120 steps", None, "exact invariant"),
    )  # fmt: skip
    finest = float(once[-1])
    curves = {
        "size": size.tolist(), "error": error.tolist(), "step": step.tolist(), "iterated": iterated.tolist(),
        "once": once.tolist(),
    }  # fmt: skip
    remarks = (
        f"One outer corrector is first order in time: between steps of {step[-1]:g} and {step[-1] / 2:g} s it changes the velocity by"
        f" {finest:.1e} of the vortex's peak, {ITERATED} correctors by {iterated[-1]:.1e}. A static mesh shows the same: the"
        " mesh's motion adds nothing to it.",
    )
    text = (
        "A box of 1 m with slip walls holds one cell of Taylor and Green's vortex (peak 1 m/s, ν = 0.02 m²/s). A circle of"
        " 0.3 m swings through its middle by 0.15 m and deforms the mesh; it is transparent, so that nothing but the mesh moves."
        " Mesh, motion and solver are those of the scenes; linear solvers to 1e-11. In space: 120 steps, cells 1/16 … 1/48."
    )
    spent = {"cpu_seconds": round(cpu_seconds() - before, 1)}
    origin = {"versions": {"OpenFOAM": foam_version()}, "scene_hash": scene.digest(), **spent}
    return Result(NAME, scene.title, text, checks, curves, remarks, origin)
