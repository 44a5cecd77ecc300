"""Stage mesh: the planform, its shape at every bend of the stroke, the layers of the sweep, and their quality."""

from __future__ import annotations

import csv
import io
import json
from dataclasses import dataclass

import numpy as np
import xarray as xr
from scipy.interpolate import CubicSpline
from tqdm import tqdm

from pipeline.errors import StageError
from pipeline.morph import Morph, MorphError, corner_triangles
from pipeline.planform import Planform, build_planform, outline_at
from pipeline.quality import cell_areas, face_measures, planform_edges
from pipeline.scene import Mesh, Scene, digest
from pipeline.stage import read_dataset, run_stage, write_dataset, write_text

QUALITY_COLUMNS = (
    "bend_deg", "shape_parameter", "max_non_orthogonality_deg", "mean_non_orthogonality_deg", "max_skewness",
    "min_area_ratio",
)  # fmt: skip


@dataclass(frozen=True)
class Family:
    """Outlines (knot, point, 2), tips (knot, 2) and bends (knot, rad) of the finger over the shape parameter."""

    parameter: np.ndarray
    outline: np.ndarray
    tip: np.ndarray
    bend: np.ndarray
    edges: np.ndarray | None = None  # (knot, edge, 2) m: where the mesh is fine, if not at the tip alone


def graded_layers(scene: Scene) -> np.ndarray:
    """z of the sweep's levels (m), from the back wall to the sheet; even over the finger, growing beyond."""
    mesh, half = scene.mesh, 0.5 * scene.tank.size[2]
    if scene.model.kind == "2d":
        return np.array([-scene.finger.width, 0.0])
    on = np.linspace(0.0, 0.5 * scene.finger.width, mesh.layers_on_finger + 1)
    beyond = _growing(half - on[-1], on[1], mesh.layers_beyond)
    back = -np.concatenate([on, on[-1] + beyond])[::-1]
    return back if scene.model.kind == "half" else np.concatenate([back, -back[-2::-1]])


def _growing(span: float, first: float, count: int) -> np.ndarray:
    """`count` cumulated steps that grow geometrically from about `first` and fill `span`."""
    low, high = 1.0, 5.0
    for _ in range(80):
        ratio = 0.5 * (low + high)
        low, high = (
            (ratio, high) if first * sum(ratio**k for k in range(1, count + 1)) < span else (low, ratio)
        )
    steps = np.cumsum(ratio ** np.arange(1, count + 1))
    return span * steps / steps[-1]


def middle_of_stroke(bend: np.ndarray) -> int:
    """Index of the shape nearest to half-way: a mesh built there has the least way to go."""
    return int(np.argmin(np.abs(bend - 0.5 * (bend.min() + bend.max()))))


def morph_family(planform: Planform, family: Family, built: int, quiet: bool = True) -> np.ndarray:
    """Node positions (knot, node, 2) of a planform built at knot `built`, for every knot."""
    fixed = np.zeros((len(planform.nodes), 2), bool)
    fixed[planform.wall] = fixed[planform.outer] = True
    morph = Morph(planform.nodes, corner_triangles(planform.triangles, planform.quads), fixed)
    closed = np.arange(len(family.parameter), dtype=float)

    def boundary(knot: float) -> np.ndarray:
        low = min(int(knot), len(closed) - 2)
        part = knot - low
        outline = family.outline[low] * (1 - part) + family.outline[low + 1] * part
        nodes = planform.nodes.copy()
        nodes[planform.wall] = outline_at(outline, planform.material)
        return nodes

    frames = np.empty((len(closed), *planform.nodes.shape))
    frames[built] = morph.relax(planform.nodes)
    ways = [range(built + 1, len(closed)), range(built - 1, -1, -1)]
    with tqdm(total=len(closed) - 1, desc="mesh shapes", disable=quiet or None, unit="shape") as bar:
        for way in ways:
            at = built
            for knot in way:
                try:
                    frames[knot] = morph.follow(frames[at], boundary, at, knot)
                except MorphError as error:
                    reached, wanted = np.degrees(family.bend[[at, knot]])
                    raise StageError(
                        f"mesh: {error} than {reached:.1f}° of bend on the way to {wanted:.1f}°;"
                        " shorten the stroke or coarsen mesh.wall_cell"
                    ) from None
                at = knot
                bar.update()
    return frames


def quality_table(planform: Planform, frames: np.ndarray, family: Family) -> list[tuple[float, ...]]:
    """One row of QUALITY_COLUMNS per shape."""
    edges = planform_edges(planform.triangles, planform.quads)
    area0 = cell_areas(planform.nodes, planform.triangles, planform.quads)
    rows: list[tuple[float, ...]] = []
    for parameter, bend, nodes in zip(family.parameter, family.bend, frames, strict=True):
        angle, skewness = face_measures(nodes, planform, edges)
        ratio = (cell_areas(nodes, planform.triangles, planform.quads) / area0).min()
        rows.append(
            (float(np.degrees(bend)), float(parameter), angle.max(), angle.mean(), skewness.max(), ratio)
        )
    return rows


def between(family: Family, frames: np.ndarray, parts: int = 3) -> tuple[Family, np.ndarray]:
    """The shapes as the motion runs through them: `parts` to each interval of the family, by the same cubic spline."""
    index = np.arange(len(family.parameter), dtype=float)
    fine = np.linspace(0, index[-1], parts * (len(index) - 1) + 1)
    parameter = np.interp(fine, index, family.parameter)

    def spline(values: np.ndarray) -> np.ndarray:
        return CubicSpline(family.parameter, values)(parameter)

    return Family(parameter, spline(family.outline), spline(family.tip), spline(family.bend)), spline(frames)


def check_quality(rows: list[tuple[float, ...]], mesh: Mesh) -> None:
    """StageError where a shape breaks mesh.max_non_orthogonality_deg, naming the bend at which it does."""
    bad = [row for row in rows if row[2] > mesh.max_non_orthogonality_deg or row[5] <= 0]
    if bad:
        first = min(bad, key=lambda row: abs(row[0]))
        good = [row[0] for row in rows if row[2] <= mesh.max_non_orthogonality_deg]
        span = f"{min(good):.0f}…{max(good):.0f}°" if good else "no bend"
        raise StageError(
            f"mesh: non-orthogonality reaches {first[2]:.1f}° at {first[0]:.1f}° of bend, more than"
            f" mesh.max_non_orthogonality_deg = {mesh.max_non_orthogonality_deg:g}; it holds over {span}:"
            " shorten the stroke or raise the limit"
        )


def read_family(scene: Scene) -> Family:
    """The shapes of kinematics.h5."""
    with read_dataset(scene.out / "kinematics.h5", "kinematics") as file:
        return Family(
            *(file[n].values for n in ("shape_parameter", "shape_outline", "shape_tip", "shape_bend")),
            edges=file["shape_edges"].values if "shape_edges" in file else None,
        )


def run(scene: Scene, quiet: bool = False) -> None:
    """Write planform.h5 and mesh_quality.csv."""
    family = read_family(scene)
    built = middle_of_stroke(family.parameter if scene.body else family.bend)
    fine = family.tip if family.edges is None else family.edges
    planform = build_planform(
        family.outline[built], fine[built], 0.5 * scene.tank.size[0], scene.tank.water_depth, scene.mesh,
        fine.reshape(-1, 2),
    )  # fmt: skip
    frames = morph_family(planform, family, built, quiet)
    along, shapes = between(family, frames)
    rows = quality_table(planform, shapes, along)
    table = io.StringIO()
    writer = csv.writer(table, lineterminator="\n")
    writer.writerow(QUALITY_COLUMNS)
    writer.writerows([[f"{value:.6g}" for value in row] for row in rows])
    write_text(scene.out / "mesh_quality.csv", table.getvalue())
    check_quality(rows, scene.mesh)
    levels = graded_layers(scene)
    write_dataset(planform_dataset(planform, frames, family, levels, scene), scene.out / "planform.h5")
    if not quiet:
        worst = max(row[2] for row in rows)
        cells = len(planform.triangles) + len(planform.quads)
        print(
            f"mesh: {cells} cells in the planform, {len(levels) - 1} layers, non-orthogonality ≤ {worst:.1f}°"
        )


def planform_dataset(
    planform: Planform, frames: np.ndarray, family: Family, levels: np.ndarray, scene: Scene
) -> xr.Dataset:
    """planform.h5 of docs/formats.md."""
    return xr.Dataset(
        {
            "points": (("shape_parameter", "node", "axis"), frames, {"units": "m"}),
            "bend": ("shape_parameter", family.bend, {"units": "rad"}),
            "triangles": (("triangle", "corner3"), planform.triangles),
            "quads": (("quad", "corner4"), planform.quads),
            "inside": (
                "triangle",
                planform.inside.astype(np.uint8),
                {"long_name": "1 in the finger's footprint"},
            ),
            "wall": ("wall_node", planform.wall, {"long_name": "nodes of the outline, counter-clockwise"}),
            "material": (
                "wall_node",
                planform.material,
                {"long_name": "position along the outline, point index"},
            ),
            "outer": ("outer_node", planform.outer),
            "levels": ("level", levels, {"units": "m", "long_name": "z of the sweep"}),
        },
        coords={"shape_parameter": ("shape_parameter", family.parameter, {"units": "Pa"})},
        attrs={
            "format": "planform",
            "format_version": 1,
            "corners": np.array(planform.corners).ravel(),
            "finger_width": scene.finger.width,
            "model": scene.model.kind,
            "scene_hash": digest(scene.settings("mesh")),
            "settings": json.dumps(scene.settings("mesh")),
        },
    )


if __name__ == "__main__":
    run_stage("mesh", __doc__, run)
