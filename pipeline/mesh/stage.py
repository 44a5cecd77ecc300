"""Stage mesh: planforms and the parts of the motion they serve, their shapes, the layers of the sweep, and their quality."""

from __future__ import annotations

from dataclasses import astuple, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from tqdm import tqdm

from fileio.errors import StageError
from fileio.formats.kinematics import Kinematics, read_kinematics
from fileio.formats.mesh_intervals import Interval, write_planform
from fileio.formats.records import MESH_QUALITY
from pipeline.geometry.planform import Planform
from pipeline.geometry.quality import Quality, shape_quality
from pipeline.mesh.fixed_bodies import FixedBody, fixed_bodies
from pipeline.mesh.intervals import (
    OVERLAP_STEPS,
    OVERLAP_TIME,
    Part,
    cumulative_deformation,
    divide,
    last_move,
)
from pipeline.mesh.morph import MorphError
from pipeline.mesh.planform import build_planform, mirrored, mirrored_shapes
from pipeline.mesh.shape_sequence import ShapeSequence, between, morph_shapes
from pipeline.mesh.sweep_levels import graded_layers
from pipeline.scene.scene import Scene
from pipeline.scene.sections import Mesh, Tank

MOST_MESHES = 6
USUAL_SHARE = 0.95  # of the time in which mesh.usual_non_orthogonality_deg is not exceeded
LEAST_CLEARANCE = (
    0.06  # of the finger's thickness, between it and the support: 1 mm of the shipped finger
)


@dataclass(frozen=True)
class Setting:
    """What all planforms of a scene share: where nodes are wanted, and what is around the finger."""

    shapes: ShapeSequence
    deformation: np.ndarray  # of each shape: pipeline.mesh.intervals.cumulative_deformation
    path: np.ndarray  # points (n, 2) near which cells stay small
    bodies: tuple[FixedBody, ...]
    motion: np.ndarray  # shape parameter after each time step, Pa
    half_width: float  # of the tank, m
    depth: float  # of the water, m
    mirror: bool  # whether the planform ends at the plane between two fingers

    @property
    def deformation_of_steps(self) -> np.ndarray:
        """Deformation (step + 1,) of the shape after each time step."""
        return np.interp(self.motion, self.shapes.parameter, self.deformation)


@dataclass(frozen=True)
class MorphedPlanform:
    """A planform, its shapes (knot, node, 2) over a part of the sequence, and the part of the motion it serves."""

    part: Part
    planform: Planform
    shapes: ShapeSequence
    frames: np.ndarray


def surroundings(kinematics: Kinematics, time_step: float, tank: Tank, mesh: Mesh, bodies: tuple[FixedBody, ...]
                 ) -> Setting:  # fmt: skip
    """The shapes of a motion and what surrounds them."""
    file = kinematics.data
    fine = "shape_edges" if "shape_edges" in file else "shape_tip"
    shapes = ShapeSequence(
        *(file[n].values for n in ("shape_parameter", "shape_outline", fine, "shape_bend"))
    )
    motion = kinematics.law(time_step * np.arange(round(kinematics.time[1] / time_step) + 1))
    outlines = shapely.linearrings(shapes.outline)
    gap, path = np.full(len(shapes.bend), np.inf), shapes.tip.reshape(-1, 2)
    if kinematics.mirror:
        plane = shapely.LineString([(0.0, 0.0), (0.0, tank.water_depth)])
        facing = shapely.union_all(
            [plane, *(body.polygon for body in bodies if body.name == "object")]
        )
        gap = shapely.distance(outlines, facing)
        nearest = shapely.shortest_line(facing, outlines[int(np.argmin(gap))])
        height = shapely.get_coordinates(nearest)[0, 1]
        count = int(np.ceil(2 * mesh.jet_reach / mesh.near_cell)) + 1
        jet = height + np.linspace(-mesh.jet_reach, mesh.jet_reach, count)
        path = np.vstack([path, np.column_stack([np.zeros(count), jet])])
    # a body that is only moved does not bend: the distance is the measure
    moved_only = "shape_edges" in file
    deformation = (
        shapes.parameter - shapes.parameter[0]
        if moved_only
        else cumulative_deformation(shapes.bend, gap)
    )
    half_width, depth = 0.5 * tank.size[0], tank.water_depth
    return Setting(shapes, deformation, path, bodies, motion, half_width, depth, kinematics.mirror)


def check_clearance(
    outlines: np.ndarray, bodies: tuple[FixedBody, ...], least: float, where: Path
) -> None:
    """StageError where a shape (knot, point, 2) is nearer to the support than `least` (m)."""
    rings = shapely.linearrings(outlines)
    for body in bodies:
        clear = float(shapely.distance(rings, body.polygon).min())
        if body.name == "support" and clear < least:
            raise StageError(
                f"{where}: support.bottom = {body.polygon.bounds[1]:g} m leaves {clear * 1e3:.2g} mm above the finger,"
                f" too little to mesh; raise it by {(least - clear) * 1e3:.2g} mm"
            )


def build_mesh(setting: Setting, mesh: Mesh, part: Part, bar: tqdm) -> MorphedPlanform:
    """The planform of a part of the motion and all its shapes; MorphError where one of them is of no use."""
    shapes = setting.shapes
    low, high, middle = np.interp(
        [part.low, part.high, part.middle], setting.deformation, shapes.parameter
    )
    shapes = shapes.within(low, high)
    built = int(np.argmin(np.abs(shapes.parameter - middle)))
    planform = build_planform(shapes.outline[built], shapes.tip[built], setting.half_width, setting.depth, mesh,
                              setting.path, setting.mirror, setting.bodies)  # fmt: skip

    share = np.zeros(len(shapes.parameter))  # of the time, by the nearest knot
    for first, end in part.intervals:
        nearest = np.abs(setting.motion[first:end, None] - shapes.parameter).argmin(1)
        share += np.bincount(nearest, minlength=len(share)) / len(setting.motion)
    unusual = 0.0

    def accept(knot: int, nodes: np.ndarray) -> None:
        nonlocal unusual
        bar.update()
        quality = shape_quality(planform, nodes)
        check_quality(quality, shapes.bend[knot], mesh)
        unusual += share[knot] * (
            quality.max_non_orthogonality_deg > mesh.usual_non_orthogonality_deg
        )
        check_share(unusual, mesh)

    return MorphedPlanform(part, planform, shapes, morph_shapes(planform, shapes, built, accept))


def check_quality(quality: Quality, bend: float, mesh: Mesh) -> None:
    """MorphError where a shape breaks mesh.max_non_orthogonality_deg, naming the bend at which it does."""
    worst = quality.max_non_orthogonality_deg
    if worst > mesh.max_non_orthogonality_deg or quality.min_area_ratio <= 0:
        raise MorphError(
            f"non-orthogonality reaches {worst:.1f}° at {np.degrees(bend):.1f}° of bend, more than"
            f" mesh.max_non_orthogonality_deg = {mesh.max_non_orthogonality_deg:g}"
        )


def check_share(unusual: float, mesh: Mesh) -> None:
    """MorphError where mesh.usual_non_orthogonality_deg is exceeded for too great a share of the time."""
    if unusual > 1 - USUAL_SHARE:
        raise MorphError(
            f"non-orthogonality exceeds mesh.usual_non_orthogonality_deg = {mesh.usual_non_orthogonality_deg:g}°"
            f" for {unusual:.1%} of the time, more than {1 - USUAL_SHARE:.0%}"
        )


def choose_meshes(setting: Setting, mesh: Mesh, sampling: int, overlap: int,
                  quiet: bool) -> tuple[list[MorphedPlanform], list[tuple]]:  # fmt: skip
    """As few planforms as keep the limits of mesh quality over the motion, and the rows of mesh_quality.csv.

    `sampling`: time steps between pictures of the sheet; `overlap`: those that a mesh serves before its interval.
    Raises StageError where MOST_MESHES do not.
    """
    deformation = setting.deformation_of_steps
    reason = ""
    for count in range(1, MOST_MESHES + 1):
        try:
            with tqdm(desc=f"mesh, {count} planforms", disable=quiet or None, unit="shape") as bar:
                parts = divide(deformation, count, sampling, overlap)
                meshes = [build_mesh(setting, mesh, part, bar) for part in parts]
            rows = quality_rows(meshes, setting.motion, overlap, mesh)
            check_share(
                sum(row[2] for row in rows if row[5] > mesh.usual_non_orthogonality_deg), mesh
            )
        except MorphError as error:
            reason = str(error)
        else:
            return meshes, rows
    raise StageError(
        f"mesh: with {MOST_MESHES} planforms {reason}: shorten the stroke, change mesh.wall_cell, or raise the limit"
    )


def quality_rows(
    meshes: list[MorphedPlanform], parameter: np.ndarray, overlap: int, mesh: Mesh
) -> list[tuple]:
    """Rows of MESH_QUALITY: each shape that an interval, or its overlap, takes; `parameter` (step + 1,) Pa is the motion's.

    Raises MorphError where a shape breaks the limit.
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
    levels = graded_layers(scene.model.kind, width, scene.tank.size[2], mesh, scene.support)
    bodies = fixed_bodies(scene.support, scene.pinch, width, mesh.wall_cell, levels)
    kinematics = read_kinematics(scene.out / "kinematics.h5")
    where = scene.folder / "scene.toml"
    check_clearance(
        kinematics.data["shape_outline"].values,
        bodies,
        LEAST_CLEARANCE * kinematics.tip_width,
        where,
    )
    setting = surroundings(kinematics, numerics.time_step, scene.tank, mesh, bodies)
    sampling, overlap = (
        numerics.sampling_steps(scene.sheet.rate_hz),
        overlap_steps(numerics.time_step),
    )
    meshes, rows = choose_meshes(setting, mesh, sampling, overlap, quiet)
    MESH_QUALITY.write(scene.out / "mesh_quality.csv", rows)
    both = scene.pinch is not None and scene.model.kind in ("half", "full")  # fingers in the mesh
    rest = last_move(setting.deformation_of_steps) + overlap
    write_planform(
        scene.out / "planform.h5",
        intervals_of([morphed.part for morphed in meshes], numerics.time_step, rest),
        {"model": scene.model.kind, "mirror": int(scene.pinch is not None and not both)},
        [mesh_values(morphed, bodies, width, both, levels) for morphed in meshes],
    )
    if not quiet:
        cells = ", ".join(str(len(s.planform.triangles) + len(s.planform.quads)) for s in meshes)
        usual, worst = mesh.usual_non_orthogonality_deg, max(row[5] for row in rows)
        share = sum(row[2] for row in rows if row[5] <= usual)
        more = f", at most {usual:g}° for {share:.1%} of the time" if worst > usual else ""
        print(
            f"mesh: planform of {cells} cells, {len(levels) - 1} layers, non-orthogonality ≤ {worst:.1f}°{more}"
        )


def overlap_steps(time_step: float) -> int:
    """Time steps of an interval's overlap: its mesh must be good from so many steps before the interval's start on."""
    return max(OVERLAP_STEPS, round(OVERLAP_TIME / time_step))


def intervals_of(parts: list[Part], time_step: float, rest: int) -> list[Interval]:
    """Which mesh serves from when to when; it is still after step `rest`."""
    spans = sorted((span, k) for k, part in enumerate(parts) for span in part.intervals)
    overlap = overlap_steps(time_step) * time_step
    return [
        Interval(
            number,
            time_step * first - (overlap if number else 0.0),
            time_step * first,
            time_step * last,
            k,
            first <= rest,
        )
        for number, ((first, last), k) in enumerate(spans)
    ]


def mesh_values(mesh: MorphedPlanform, bodies: tuple[FixedBody, ...], width: float, both_fingers: bool,
                levels: np.ndarray) -> dict[str, Any]:  # fmt: skip
    """Variables and attributes of a mesh in planform.h5; `width` (m) is the finger's."""
    planform, frames = mesh.planform, mesh.frames
    names = ["water", "finger", *(body.name for body in bodies)]
    half = 0.5 * width
    reach = [0.0, half, *(body.half_width for body in bodies)]
    if both_fingers:
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
    }
