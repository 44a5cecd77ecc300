"""Stage mesh: planforms and the parts of the motion they serve, their shapes, the layers of the sweep, and their quality."""

from __future__ import annotations

import csv
import io
from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely
from tqdm import tqdm

from fileio.atomic import write_text
from fileio.errors import StageError
from fileio.formats.kinematics import read_kinematics
from fileio.formats.mesh_intervals import Interval, overlap_steps, write_planform
from pipeline.geometry.planform import Planform
from pipeline.geometry.quality import Quality, shape_quality
from pipeline.mesh.fixed_bodies import Body, fixed_bodies
from pipeline.mesh.intervals import Part, cumulative_deformation, divide, last_move
from pipeline.mesh.morph import MorphError
from pipeline.mesh.planform import build_planform, mirrored, mirrored_shapes
from pipeline.mesh.shape_sequence import Family, between, morph_family
from pipeline.mesh.sweep_levels import graded_layers
from pipeline.scene.scene import Scene
from pipeline.scene.sections import Mesh
from pipeline.stage_settings import settings_of

QUALITY_COLUMNS = (
    "interval", "mesh", "time_share", "bend_deg", "shape_parameter", "max_non_orthogonality_deg",
    "mean_non_orthogonality_deg", "max_skewness", "min_area_ratio",
)  # fmt: skip
MOST_MESHES = 6
USUAL_SHARE = 0.95  # of the time in which mesh.usual_non_orthogonality_deg is not exceeded
LEAST_CLEARANCE = 0.001  # m between the finger and the support


@dataclass(frozen=True)
class Setting:
    """What all planforms of a scene share: where nodes are wanted, and what is around the finger."""

    scene: Scene
    family: Family
    deformation: np.ndarray  # of each shape of the family: pipeline.mesh.intervals.cumulative_deformation
    path: np.ndarray  # points (n, 2) near which cells stay small
    bodies: tuple[Body, ...]
    motion: np.ndarray  # shape parameter after each time step, Pa

    @property
    def deformation_of_steps(self) -> np.ndarray:
        """Deformation (step + 1,) of the shape after each time step."""
        return np.interp(self.motion, self.family.parameter, self.deformation)

    @property
    def mirror(self) -> bool:
        """Whether the planform ends at the plane between two fingers."""
        return self.scene.pinch is not None


@dataclass(frozen=True)
class MorphedPlanform:
    """A planform, its shapes (knot, node, 2) over a part of the family, and the part of the motion it serves."""

    part: Part
    planform: Planform
    family: Family
    frames: np.ndarray


def read_setting(scene: Scene, levels: np.ndarray) -> Setting:
    """The shapes of kinematics.h5 and what surrounds them. Raises StageError where the finger meets the support."""
    step = scene.numerics.time_step
    kinematics = read_kinematics(scene.out / "kinematics.h5")
    file = kinematics.data
    fine = "shape_edges" if "shape_edges" in file else "shape_tip"
    family = Family(*(file[n].values for n in ("shape_parameter", "shape_outline", fine, "shape_bend")))
    motion = kinematics.law(step * np.arange(round(scene.motion.end_time / step) + 1))
    mirror = scene.pinch is not None
    bodies = fixed_bodies(scene, levels, mirror)
    outlines = shapely.linearrings(family.outline)
    for body in bodies:
        clear = float(shapely.distance(outlines, body.polygon).min())
        if scene.support is not None and body.name == "support" and clear < LEAST_CLEARANCE:
            raise StageError(
                f"{scene.folder / 'scene.toml'}: support.bottom = {scene.support.bottom:g} m leaves {clear * 1e3:.2g} mm"
                f" above the finger, too little to mesh; raise it by {(LEAST_CLEARANCE - clear) * 1e3:.2g} mm"
            )
    gap, path = np.full(len(family.bend), np.inf), family.tip.reshape(-1, 2)
    if mirror:
        plane = shapely.LineString([(0.0, 0.0), (0.0, scene.tank.water_depth)])
        facing = shapely.union_all([plane, *(body.polygon for body in bodies if body.name == "object")])
        gap = shapely.distance(outlines, facing)
        nearest = shapely.shortest_line(facing, outlines[int(np.argmin(gap))])
        height = shapely.get_coordinates(nearest)[0, 1]
        count = int(np.ceil(2 * scene.mesh.jet_reach / scene.mesh.near_cell)) + 1
        jet = height + np.linspace(-scene.mesh.jet_reach, scene.mesh.jet_reach, count)
        path = np.vstack([path, np.column_stack([np.zeros(count), jet])])
    # a body that is only moved does not bend: the distance is the measure
    deformation = (
        family.parameter - family.parameter[0] if scene.body else cumulative_deformation(family.bend, gap)
    )
    return Setting(scene, family, deformation, path, bodies, motion)


def build_mesh(setting: Setting, part: Part, bar: tqdm) -> MorphedPlanform:
    """The planform of a part of the motion and all its shapes; MorphError where one of them is of no use."""
    mesh, family = setting.scene.mesh, setting.family
    low, high, middle = np.interp([part.low, part.high, part.middle], setting.deformation, family.parameter)
    family = family.within(low, high)
    built = int(np.argmin(np.abs(family.parameter - middle)))
    tank = 0.5 * setting.scene.tank.size[0], setting.scene.tank.water_depth
    planform = build_planform(
        family.outline[built], family.tip[built], *tank, mesh, setting.path, setting.mirror, setting.bodies
    )

    share = np.zeros(len(family.parameter))  # of the time, by the nearest knot
    for first, end in part.intervals:
        nearest = np.abs(setting.motion[first:end, None] - family.parameter).argmin(1)
        share += np.bincount(nearest, minlength=len(share)) / len(setting.motion)
    unusual = 0.0

    def look(knot: int, nodes: np.ndarray) -> None:
        nonlocal unusual
        bar.update()
        quality = shape_quality(planform, nodes)
        check_quality(quality, family.bend[knot], mesh)
        unusual += share[knot] * (quality.max_non_orthogonality_deg > mesh.usual_non_orthogonality_deg)
        check_share(unusual, mesh)

    return MorphedPlanform(part, planform, family, morph_family(planform, family, built, look))


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


def choose_meshes(setting: Setting, quiet: bool) -> tuple[list[MorphedPlanform], list[tuple]]:
    """As few planforms as keep the limits of mesh quality over the motion, and the rows of mesh_quality.csv.

    Raises StageError where MOST_MESHES do not.
    """
    scene = setting.scene
    deformation = setting.deformation_of_steps
    sampling = scene.numerics.sampling_steps(scene.sheet.rate_hz)
    overlap = overlap_steps(scene.numerics.time_step)
    reason = ""
    for count in range(1, MOST_MESHES + 1):
        try:
            with tqdm(desc=f"mesh, {count} planforms", disable=quiet or None, unit="shape") as bar:
                meshes = [
                    build_mesh(setting, part, bar) for part in divide(deformation, count, sampling, overlap)
                ]
            rows = quality_rows(meshes, setting.motion, overlap, scene.mesh)
            check_share(
                sum(row[2] for row in rows if row[5] > scene.mesh.usual_non_orthogonality_deg), scene.mesh
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
    """Rows of QUALITY_COLUMNS: each shape that an interval, or its overlap, takes; `parameter` (step + 1,) Pa is the motion's.

    Raises MorphError where a shape breaks the limit.
    """
    intervals = sorted(
        (interval, k) for k, morphed in enumerate(meshes) for interval in morphed.part.intervals
    )
    shapes = [between(morphed.family, morphed.frames) for morphed in meshes]
    quality = [
        [shape_quality(s.planform, x) for x in fine[1]] for s, fine in zip(meshes, shapes, strict=True)
    ]
    rows = []
    for number, ((first, last), k) in enumerate(intervals):
        family = shapes[k][0]
        begin = max(0, first - overlap)
        taken = np.abs(parameter[begin : last + 1, None] - family.parameter).argmin(1)
        own = taken[first - begin :] if last == len(parameter) - 1 else taken[first - begin : -1]
        share = np.bincount(own, minlength=len(family.parameter)) / len(parameter)
        for at in range(taken.min(), taken.max() + 1):
            found = quality[k][at]
            check_quality(found, family.bend[at], mesh)
            shape = float(np.degrees(family.bend[at])), float(family.parameter[at])
            rows.append((number, k, share[at], *shape, *found.values()))
    return rows


def run(scene: Scene, quiet: bool = False) -> None:
    """Write planform.h5 and mesh_quality.csv."""
    levels = graded_layers(scene)
    setting = read_setting(scene, levels)
    meshes, rows = choose_meshes(setting, quiet)
    table = io.StringIO()
    writer = csv.writer(table, lineterminator="\n")
    writer.writerow(QUALITY_COLUMNS)
    writer.writerows([[f"{value:.6g}" for value in row] for row in rows])
    write_text(scene.out / "mesh_quality.csv", table.getvalue())
    one_finger = scene.pinch is not None and not _both_fingers(scene)
    write_planform(
        scene.out / "planform.h5",
        intervals_of(meshes, setting),
        {"model": scene.model.kind, "mirror": int(one_finger)},
        [mesh_values(morphed, setting, levels) for morphed in meshes],
        settings_of(scene, "mesh"),
    )
    if not quiet:
        cells = ", ".join(str(len(s.planform.triangles) + len(s.planform.quads)) for s in meshes)
        usual = scene.mesh.usual_non_orthogonality_deg
        print(
            f"mesh: planform of {cells} cells, {len(levels) - 1} layers, non-orthogonality ≤"
            f" {max(row[5] for row in rows):.1f}°, {usual:g}° for {sum(r[2] for r in rows if r[5] <= usual):.1%} of the time"
        )


def intervals_of(meshes: list[MorphedPlanform], setting: Setting) -> list[Interval]:
    """Which mesh serves from when to when."""
    step = setting.scene.numerics.time_step
    spans = sorted((span, k) for k, morphed in enumerate(meshes) for span in morphed.part.intervals)
    rest = last_move(setting.deformation_of_steps) + overlap_steps(step)
    return [
        Interval(number, step * first, step * last, k, first <= rest)
        for number, ((first, last), k) in enumerate(spans)
    ]


def _both_fingers(scene: Scene) -> bool:
    """Whether the mesh holds both fingers of a pinch."""
    return scene.pinch is not None and scene.model.kind in ("half", "full")


def mesh_values(mesh: MorphedPlanform, setting: Setting, levels: np.ndarray) -> dict[str, Any]:
    """Variables and attributes of a mesh in planform.h5."""
    planform, frames, family = mesh.planform, mesh.frames, mesh.family
    names = ["water", "finger", *(body.name for body in setting.bodies)]
    half = 0.5 * setting.scene.finger.width
    reach = [0.0, half, *(body.half_width for body in setting.bodies)]
    if _both_fingers(setting.scene):
        frames = mirrored_shapes(frames, planform)
        planform = mirrored(planform, len(names))
        names.append("mirrored_finger")
        reach.append(half)
    return {
        "shape_parameter": family.parameter,
        "points": frames,
        "bend": family.bend,
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
