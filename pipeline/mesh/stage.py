"""Stage mesh: planforms, the parts of the motion they serve, their shapes and quality."""

from dataclasses import astuple, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from numpy import ndarray
from tqdm import tqdm

from pipeline.formats.kinematics import Kinematics, read_kinematics
from pipeline.formats.mesh_intervals import Interval, write_planform
from pipeline.formats.records import MESH_QUALITY
from pipeline.geometry.planform import Planform
from pipeline.geometry.quality import shape_quality
from pipeline.mesh.fixed_bodies import FixedBody, fixed_bodies
from pipeline.mesh.intervals import (
    OVERLAP_STEPS,
    OVERLAP_TIME,
    Part,
    cumulative_deformation,
    divide,
    last_move,
)
from pipeline.mesh.morph import MorphError, check_quality
from pipeline.mesh.planform import build_planform, mirrored, mirrored_shapes
from pipeline.mesh.shape_sequence import ShapeSequence, behind_tip, between, morph_shapes
from pipeline.mesh.sweep_levels import graded_layers
from pipeline.scene.obstacle import OBSTACLE_PATCHES
from pipeline.scene.scene import Scene
from pipeline.scene.sections import Mesh, Tank
from piv.files.errors import StageError

_MOST_MESHES = 8  # a finger of 91 mm that swings by 65° to both sides needs them
_FEW_CELLS = 3.0  # between a body and the tank's bounds: too few to follow it
_USUAL_SHARE = 0.95  # of the time in which mesh.usual_non_orthogonality_deg is not exceeded
_LEAST_CLEARANCE = 0.06  # of the finger's thickness, between it and the support


@dataclass(frozen=True)
class _Setting:
    """What all planforms of a scene share."""

    shapes: ShapeSequence
    deformation: ndarray  # of each shape: `cumulative_deformation`
    jet: ndarray  # points (n, 2) of a pinch's jet, near which cells stay small
    bodies: tuple[FixedBody, ...]
    motion: ndarray  # shape parameter after each time step, Pa
    half_width: float  # of the tank, m
    depth: float  # of the water, m
    mirror: bool  # whether the planform ends at the plane between two fingers

    @property
    def deformation_of_steps(self) -> ndarray:
        """Deformation (step + 1,) of the shape after each time step."""
        return np.interp(self.motion, self.shapes.parameter, self.deformation)


@dataclass(frozen=True)
class _MorphedPlanform:
    """A planform, and its shapes (knot, node, 2) over the part of the motion that it serves."""

    part: Part
    planform: Planform
    shapes: ShapeSequence
    frames: ndarray


def _setting_of(
    kinematics: Kinematics, time_step: float, tank: Tank, mesh: Mesh, bodies: tuple[FixedBody, ...]
) -> _Setting:
    """The shapes of a motion and what surrounds them."""
    file = kinematics.data
    rigid = "shape_edges" in file
    fine = "edges" if rigid else "tip"
    motion = kinematics.law(time_step * np.arange(round(kinematics.time[1] / time_step) + 1))
    names = "parameter", "outline", fine, "bend"
    parameter, outline, tip, bend = (file[f"shape_{name}"].values for name in names)
    beyond, dorsal = (file[f"shape_{name}_direction"].values for name in ("tip", "dorsal"))
    near = behind_tip(parameter, tip, beyond, dorsal, motion, mesh.near_offset)
    shapes = ShapeSequence(parameter, outline, tip, bend, near)
    outlines = shapely.linearrings(shapes.outline)
    gap, jet = np.full(len(shapes.bend), np.inf), np.empty((0, 2))
    if obstacles := [body.polygon for body in bodies if body.name in OBSTACLE_PATCHES]:
        gap = shapely.distance(outlines, shapely.union_all(obstacles))
    if kinematics.mirror:
        plane = shapely.LineString([(0.0, 0.0), (0.0, tank.water_depth)])
        objects = [body.polygon for body in bodies if body.name == "object"]
        facing = shapely.union_all([plane, *objects])
        gap = shapely.distance(outlines, facing)
        nearest = shapely.shortest_line(facing, outlines[int(np.argmin(gap))])
        height = shapely.get_coordinates(nearest)[0, 1]
        count = int(np.ceil(2 * mesh.jet_reach / mesh.near_cell)) + 1
        along = height + np.linspace(-mesh.jet_reach, mesh.jet_reach, count)
        jet = np.column_stack([np.zeros(count), along])
    # a rigid body does not bend: the distance is the measure
    deformation = shapes.parameter - shapes.parameter[0]
    if not rigid:
        deformation = cumulative_deformation(shapes.bend, gap)
    half_width, depth = 0.5 * tank.size[0], tank.water_depth
    return _Setting(shapes, deformation, jet, bodies, motion, half_width, depth, kinematics.mirror)


def _check_clearance(
    outlines: ndarray, bodies: tuple[FixedBody, ...], least: float, where: Path
) -> None:
    """StageError where a shape (knot, point, 2) is nearer to a fixed body than `least` (m)."""
    rings = shapely.linearrings(outlines)
    for body in bodies:
        clear = float(shapely.distance(rings, body.polygon).min())
        if body.name in OBSTACLE_PATCHES and clear < least:
            number = OBSTACLE_PATCHES.index(body.name)
            raise StageError(
                f"{where}: obstacle[{number}] is {clear * 1e3:.2g} mm from the finger at its"
                f" nearest, too little to mesh; move it by {(least - clear) * 1e3:.2g} mm"
            )
        if body.name == "support" and clear < least:
            raise StageError(
                f"{where}: support.bottom = {body.polygon.bounds[1]:g} m leaves"
                f" {clear * 1e3:.2g} mm above the finger, too little to mesh;"
                f" raise it by {(least - clear) * 1e3:.2g} mm"
            )


def _build_mesh(setting: _Setting, mesh: Mesh, part: Part, bar: tqdm) -> _MorphedPlanform:
    """The planform of a part of the motion and all its shapes; MorphError where one is too bad."""
    shapes = setting.shapes
    ends = [part.low, part.high, part.middle]
    low, high, middle = np.interp(ends, setting.deformation, shapes.parameter)
    near = shapes.tip
    shapes = shapes.within(low, high)
    built = int(np.argmin(np.abs(shapes.parameter - middle)))
    if mesh.near == "tip":
        near = shapes.near[built]
    planform = build_planform(
        shapes.outline[built],
        shapes.tip[built],
        setting.half_width,
        setting.depth,
        mesh,
        np.vstack([near.reshape(-1, 2), setting.jet]),
        setting.mirror,
        setting.bodies,
    )
    share = np.zeros(len(shapes.parameter))  # of the time, by the nearest knot
    for first, end in part.intervals:
        nearest = np.abs(setting.motion[first:end, None] - shapes.parameter).argmin(1)
        share += np.bincount(nearest, minlength=len(share)) / len(setting.motion)
    unusual = 0.0

    def accept(knot: int, nodes: ndarray) -> None:
        nonlocal unusual
        bar.update()
        quality = shape_quality(planform, nodes)
        check_quality(quality, shapes.bend[knot], mesh)
        worst = quality.max_non_orthogonality_deg
        unusual += share[knot] * (worst > mesh.usual_non_orthogonality_deg)
        _check_share(unusual, mesh)

    return _MorphedPlanform(part, planform, shapes, morph_shapes(planform, shapes, built, accept))


def _check_share(unusual: float, mesh: Mesh) -> None:
    """MorphError where mesh.usual_non_orthogonality_deg is exceeded for too much of the time."""
    if unusual > 1 - _USUAL_SHARE:
        usual = mesh.usual_non_orthogonality_deg
        raise MorphError(
            f"non-orthogonality exceeds mesh.usual_non_orthogonality_deg = {usual:g}°"
            f" for {unusual:.1%} of the time, more than {1 - _USUAL_SHARE:.0%}"
        )


def _choose_meshes(
    setting: _Setting, mesh: Mesh, sampling: int, overlap: int, quiet: bool
) -> tuple[list[_MorphedPlanform], list[tuple]]:
    """As few planforms as keep the limits of mesh quality, and the rows of mesh_quality.csv.

    `sampling`: time steps between pictures of the sheet; `overlap`: steps that a mesh serves before
    its interval. Raises StageError where _MOST_MESHES do not suffice.
    """
    deformation = setting.deformation_of_steps
    reason = ""
    for count in range(1, _MOST_MESHES + 1):
        try:
            with tqdm(desc=f"mesh, {count} planforms", disable=quiet or None, unit="shape") as bar:
                parts = divide(deformation, count, sampling, overlap)
                meshes = [_build_mesh(setting, mesh, part, bar) for part in parts]
            rows = _quality_rows(meshes, setting.motion, overlap, mesh)
            unusual = [row[2] for row in rows if row[5] > mesh.usual_non_orthogonality_deg]
            _check_share(sum(unusual), mesh)
        except MorphError as error:
            reason = str(error)
        else:
            return meshes, rows
    raise StageError(
        f"mesh: with {_MOST_MESHES} planforms {reason}: {_room(setting, mesh)}shorten the stroke,"
        " change mesh.wall_cell, or raise the limit"
    )


def _room(setting: _Setting, mesh: Mesh) -> str:
    """Says where the body comes so near to the tank's bounds that few cells fit between them."""
    low, high = (reach(setting.shapes.outline, (0, 1)) for reach in (np.min, np.max))
    near = {
        "bottom": low[1], "surface": setting.depth - high[1],
        "wall": setting.half_width - max(-low[0], high[0]),
    }  # fmt: skip
    place = min(near, key=lambda name: near[name])
    if near[place] > _FEW_CELLS * mesh.near_cell:
        return ""
    return (
        f"the body comes within {near[place]:.2g} m of the {place}, where few cells of"
        f" mesh.near_cell = {mesh.near_cell:g} m fit; move finger.root, "
    )


def _quality_rows(
    meshes: list[_MorphedPlanform], parameter: ndarray, overlap: int, mesh: Mesh
) -> list[tuple]:
    """Rows of MESH_QUALITY: each shape that an interval or its overlap takes.

    `parameter` (step + 1,) Pa is the motion's. Raises MorphError where a shape breaks the limit.
    """
    intervals = sorted(
        (interval, k) for k, morphed in enumerate(meshes) for interval in morphed.part.intervals
    )
    fine = [between(morphed.shapes, morphed.frames) for morphed in meshes]
    quality = [
        [shape_quality(s.planform, x) for x in frames]
        for s, (_, frames) in zip(meshes, fine, strict=True)
    ]
    rows = []
    for number, ((first, last), k) in enumerate(intervals):
        shapes = fine[k][0]
        begin = max(0, first - overlap)
        taken = np.abs(parameter[begin : last + 1, None] - shapes.parameter).argmin(1)
        own = taken[first - begin :] if last == len(parameter) - 1 else taken[first - begin : -1]
        share = np.bincount(own, minlength=len(shapes.parameter)) / len(parameter)
        for at in range(taken.min(), taken.max() + 1):
            measures = quality[k][at]
            check_quality(measures, shapes.bend[at], mesh)
            shape = float(np.degrees(shapes.bend[at])), float(shapes.parameter[at])
            rows.append((number, k, share[at], *shape, *astuple(measures)))
    return rows


def run(scene: Scene, quiet: bool = False) -> None:
    """Write planform.h5 and mesh_quality.csv."""
    mesh, numerics, width = scene.mesh, scene.numerics, scene.finger.width
    obstacles, depth = scene.obstacle or (), scene.tank.size[2]
    reaches = tuple(thing.half_depth(depth) for thing in obstacles)
    if scene.support is not None:
        reaches += (0.5 * scene.support.size[2],)
    levels = graded_layers(scene.model.kind, width, depth, mesh, reaches)
    bodies = fixed_bodies(scene.support, scene.pinch, width, mesh.wall_cell, levels, obstacles)
    kinematics = read_kinematics(scene.out / "kinematics.h5")
    where = scene.folder / "scene.toml"
    outlines = kinematics.data["shape_outline"].values
    _check_clearance(outlines, bodies, _LEAST_CLEARANCE * kinematics.tip_width, where)
    setting = _setting_of(kinematics, numerics.time_step, scene.tank, mesh, bodies)
    sampling = numerics.sampling_steps(scene.sheet.rate_hz)
    overlap = overlap_steps(numerics.time_step)
    meshes, rows = _choose_meshes(setting, mesh, sampling, overlap, quiet)
    MESH_QUALITY.write(scene.out / "mesh_quality.csv", rows)
    # a coupled finger may move where the first guess rests, and a body in a current may not at all
    moves = np.ptp(setting.deformation_of_steps) > 0
    still = last_move(setting.deformation_of_steps) + overlap if moves else -1
    still = len(setting.motion) if scene.coupled else still
    write_planform(
        scene.out / "planform.h5",
        _intervals_of([morphed.part for morphed in meshes], numerics.time_step, still),
        {
            "model": scene.model.kind,
            "mirror": int(scene.pinch is not None and not scene.both_fingers),
        },
        [_mesh_values(morphed, bodies, scene, levels) for morphed in meshes],
    )
    if not quiet:
        cells = ", ".join(str(len(s.planform.triangles) + len(s.planform.quads)) for s in meshes)
        usual, worst = mesh.usual_non_orthogonality_deg, max(row[5] for row in rows)
        share = sum(row[2] for row in rows if row[5] <= usual)
        more = f", at most {usual:g}° for {share:.1%} of the time" if worst > usual else ""
        print(
            f"mesh: planform of {cells} cells, {len(levels) - 1} layers,"
            f" non-orthogonality ≤ {worst:.1f}°{more}"
        )


def overlap_steps(time_step: float) -> int:
    """Time steps before an interval's start from which on its mesh must be good."""
    return max(OVERLAP_STEPS, round(OVERLAP_TIME / time_step))


def _intervals_of(parts: list[Part], time_step: float, rest: int) -> list[Interval]:
    """Which mesh serves from when to when; it is still after step `rest`."""
    spans = sorted((span, k) for k, part in enumerate(parts) for span in part.intervals)
    overlap = overlap_steps(time_step) * time_step
    result = []
    for number, ((first, last), k) in enumerate(spans):
        start, end = time_step * first, time_step * last
        begin = start - (overlap if number else 0.0)
        result.append(Interval(number, begin, start, end, k, first <= rest))
    return result


def _mesh_values(
    mesh: _MorphedPlanform, bodies: tuple[FixedBody, ...], scene: Scene, levels: ndarray
) -> dict[str, Any]:
    """Variables and attributes of a mesh in planform.h5."""
    planform, frames = mesh.planform, mesh.frames
    built = {"built": planform.nodes, "fixed": planform.fixed.astype(np.uint8)}
    names = ["water", "finger", *(body.name for body in bodies)]
    half = 0.5 * scene.finger.width
    reach = [0.0, half, *(body.half_width for body in bodies)]
    if scene.both_fingers:
        frames = mirrored_shapes(frames, planform)
        planform = mirrored(planform, len(names))
        names.append("mirrored_finger")
        reach.append(half)
    return {
        "shape_parameter": mesh.shapes.parameter,
        "points": frames,
        "bend": mesh.shapes.bend,
        "triangles": planform.triangles,
        "quads": planform.quads,
        "body": planform.body.astype(np.uint8),
        "body_name": np.array(names, object),
        "body_half_width": np.array(reach),
        "wall": planform.wall,
        "material": planform.material,
        "outer": planform.outer,
        "levels": levels,
        "corners": np.array(planform.corners).ravel(),
        **(built if scene.coupled else {}),  # which moves the mesh itself
    }
