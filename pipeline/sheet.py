"""Stage sheet: the flow in the laser sheet on a regular grid, as a plane series."""

import json
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np
import pyvista as pv
import shapely
import xarray as xr
from numpy import ndarray
from tqdm import tqdm

from pipeline.formats.kinematics import Kinematics, read_kinematics
from pipeline.formats.mesh_intervals import read_intervals, read_planform
from pipeline.kinematics.camera_window import unseen_tip
from pipeline.openfoam.surface_vtk import read_surface, sampled_surfaces
from pipeline.scene.measurement import Camera
from pipeline.scene.scene import Scene
from piv.files.errors import StageError
from piv.files.provenance import versions
from piv.formats.plane_writer import instant, new_series, write_blocks

FIELDS = ("u", "v", "w", "dwdz", "p")
ODD = ("u",)  # across the plane x = 0 between two fingers; the other fields are even
_OUTLINE = 1e-5  # m, by which a fixed body in the picture may differ from its shape
_INSET = 1e-7  # m, of points of the mirror plane into the mesh


def sheet_axes(
    camera: Camera, spacing: float, margin: float, symmetric: bool = False
) -> tuple[ndarray, ndarray]:
    """Grid axes (m) that cover the camera's view and a margin; x about 0 where `symmetric`."""
    axes: list[ndarray] = []
    assert camera.centre is not None
    for middle, pixels in zip(camera.centre, (camera.columns, camera.rows), strict=True):
        half = 0.5 * pixels * camera.scale_mm_per_px * 1e-3 + margin
        if symmetric and not axes:
            middle, half = 0.0, abs(middle) + half
        count = int(np.ceil(half / spacing))
        axes.append(middle + spacing * np.arange(-count, count + 1))
    return axes[0], axes[1]


def view_axes(
    view: tuple[float, ...], scene: Scene, symmetric: bool = False
) -> tuple[ndarray, ndarray]:
    """Grid axes (m) of the water in a view. StageError where the view shows no water.

    Its points are those of the camera's view where both see; x about 0 where `symmetric`.
    """
    half, depth, spacing = scene.tank.size[0] / 2, scene.tank.water_depth, scene.sheet.spacing
    low, high = np.maximum(view[::2], (-half, 0.0)), np.minimum(view[1::2], (half, depth))
    if np.any(high - low < 2 * spacing):
        raise StageError(
            f"view {view} m shows no water of {scene.folder}; give x0 x1 y0 y1 in the tank frame"
        )
    across, up = scene.camera.centre or (0.0, 0.0)
    middle = np.array([0.0 if symmetric else across, up])
    first = np.ceil((low - middle) / spacing - 1e-6)
    last = np.floor((high - middle) / spacing + 1e-6)
    x, y = (m + spacing * np.arange(a, b + 1) for m, a, b in zip(middle, first, last, strict=True))
    return x, y


def _sample_plane(path: Path, x: ndarray, y: ndarray, flat: bool) -> dict[str, ndarray]:
    """FIELDS on the grid (y, x), kinematic pressure; NaN outside the water."""
    plane = read_surface(path)
    grid = pv.RectilinearGrid(x, y, plane.points[:1, 2])
    # the default locator takes a third longer for the same values
    sampled = grid.sample(plane, locator="static_cell")
    shape = (len(y), len(x))
    outside = np.asarray(sampled["vtkValidPointMask"]).reshape(shape) == 0
    velocity = np.asarray(sampled["U"]).reshape(*shape, 3)
    fields = {
        "u": velocity[..., 0],
        "v": velocity[..., 1],
        "w": np.zeros(shape) if flat else velocity[..., 2],
        "dwdz": np.zeros(shape)
        if flat
        else np.asarray(sampled["gradU"]).reshape(*shape, 9)[..., 8],
        "p": np.asarray(sampled["p"]).reshape(shape),
    }
    return {
        name: np.where(outside, np.nan, field).astype(np.float32) for name, field in fields.items()
    }


def sample_mirrored(path: Path, x: ndarray, y: ndarray, flat: bool) -> dict[str, ndarray]:
    """FIELDS on a grid about x = 0 from a plane of x <= 0; u = 0 on the symmetry plane."""
    left = x[: len(x) // 2 + 1].copy()
    left[-1] -= _INSET
    fields = _sample_plane(path, left, y, flat)
    fields["u"][:, -1] *= 0.0  # NaN stays NaN
    return {name: whole_picture(name, field) for name, field in fields.items()}


def whole_picture(name: str, left: ndarray) -> ndarray:
    """A field (y, x) of x <= 0, whose last column has x = 0, joined with its mirror image."""
    sign = left.dtype.type(-1 if name in ODD else 1)
    return np.concatenate([left, sign * left[:, -2::-1]], axis=1)


def _frames(
    planes: Iterable[tuple[float, Path]],
    mirrored: bool,
    flat: bool,
    density: float,
    kinematics: Kinematics,
    x: ndarray,
    y: ndarray,
) -> Iterator[xr.Dataset]:
    """The variables of each plane; NaN inside the fingers. mirrored: planes of x <= 0."""
    mesh_x, mesh_y = np.meshgrid(x, y)
    sample = sample_mirrored if mirrored else _sample_plane
    for time, path in planes:
        fields = sample(path, x, y, flat)
        fields["p"] = fields["p"] * np.float32(density)
        fingers = kinematics.at(time)
        inside = shapely.contains_xy(shapely.Polygon(fingers["outline"][0]), mesh_x, mesh_y)
        if kinematics.mirror:
            inside |= inside[:, ::-1]
        valid = ~inside & np.isfinite(fields["u"])
        for name in FIELDS:
            fields[name][~valid] = np.nan
        yield instant(fields | {"valid": valid.astype(np.uint8)} | fingers)


def run(
    scene: Scene,
    quiet: bool = False,
    view: tuple[float, ...] | None = None,
    output: Path | None = None,
    most: int | None = None,
) -> None:
    """Write sheet.h5 frame by frame, or another view (m: x0, x1, y0, y1) to `output`.

    `most`: planes, evenly spread over all; None: all of them.
    """
    kinematics = read_kinematics(scene.motion_folder / "kinematics.h5")
    if view is None:
        if scene.body is None and (
            why := unseen_tip(scene.camera, kinematics.data["shape_tip"].values)
        ):
            raise StageError(f"{scene.folder / 'scene.toml'}: {why}")
        x, y = sheet_axes(
            scene.camera, scene.sheet.spacing, scene.sheet.margin, symmetric=kinematics.mirror
        )
    else:
        reach = max(abs(view[0]), abs(view[1]))  # a mirrored sheet is symmetric
        view = (-reach, reach, *view[2:]) if kinematics.mirror else view
        x, y = view_axes(view, scene, symmetric=kinematics.mirror)
    intervals = read_intervals(scene.motion_folder)
    planes = sampled_surfaces(scene.out / "case", intervals, "sheet")
    planes = planes[:: scene.sheet.every or 1]
    chosen = np.linspace(0, len(planes) - 1, min(most or len(planes), len(planes)))
    planes = [planes[k] for k in chosen.round().astype(int)]
    mirrored = bool(read_planform(scene.motion_folder, intervals[0].mesh).attrs["mirror"])
    flat, density = scene.model.kind == "2d", scene.fluid.density
    path = output or scene.out / "sheet.h5"
    about = {"source": "cfd", "tip_width": kinematics.tip_width, "versions": json.dumps(versions())}
    if scene.obstacle:
        shapes = (shapely.simplify(thing.polygon, _OUTLINE) for thing in scene.obstacle)
        about["fixed_bodies"] = json.dumps(
            [np.round(shapely.get_coordinates(shape.exterior)[:-1], 7).tolist() for shape in shapes]
        )
    shown = tqdm(planes, "sheet", disable=quiet or None)
    pictures = _frames(shown, mirrored, flat, density, kinematics, x, y)
    times = np.array([time for time, _ in planes])
    write_blocks(pictures, path, new_series(times, x, y).assign_attrs(about))
    if not quiet:
        print(f"sheet: {len(planes)} planes of {len(x)}×{len(y)} points")
