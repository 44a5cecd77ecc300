"""A laboratory for the tests: the finger's kinematics, an analytic flow around it, pictures."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import xarray as xr

from fileio.formats.kinematics import Kinematics, read_kinematics, write_kinematics
from fileio.formats.plane_series import make_plane
from pipeline.kinematics.stage import kinematics_values
from pipeline.scene.scene import load_scene
from piv.images.masks import inside_polygon
from piv.synthetic.camera import Camera, Seeding
from piv.synthetic.particle_images import Body, add_particles, expose, sheet_light
from piv.synthetic.particles import Box, seed_particles
from postprocess.lab.data.pose import Pose
from postprocess.lab.registration.silhouette import left_of
from postprocess.lab.virtual.virtual_laboratory import SetUp, camera_for

CASE = Path(__file__).parents[1] / "cases" / "single_finger"


def finger_kinematics(folder: Path) -> Kinematics:
    """The motion of single_finger."""
    path = folder / "kinematics.h5"
    write_kinematics(path, kinematics_values(load_scene(CASE, "smoke")))
    return read_kinematics(path)


def set_up(kinematics: Kinematics, columns: int = 400, seed: int = 1, **more) -> SetUp:
    """A small camera before the finger, with errors of set-up."""
    errors = {"shift_mm": (1.0, -0.6), "turn_deg": 2.0, "scale_error": 0.01} | more
    return SetUp(
        camera_for(kinematics.root, columns, 160 / columns, 500.0),
        Seeding(density_ppp=0.06),
        seed=seed,
        **errors,
    )


def stated_pose(kinematics: Kinematics, camera: Camera) -> Pose:
    """What the laboratory believes."""
    at = np.asarray(camera.origin_px) + np.asarray(kinematics.root) / camera.pixel
    return Pose(camera.scale_mm_per_px, 0.0, kinematics.root, (float(at[0]), float(at[1])))


def inside_sum(integral: np.ndarray, outline: np.ndarray, mean: float = 0.0) -> float:
    """Sum of the evidence inside a counter-clockwise outline (point, 2) px."""
    after = np.roll(outline, -1, axis=0)
    return sum(left_of(integral, mean, *a, *b) for a, b in zip(outline, after, strict=True))


def still_picture(kinematics: Kinematics, lab: SetUp, pressure: float, seed: int) -> np.ndarray:
    """One picture (row 0 at the top) of fresh particles around the finger at a pressure (Pa)."""
    camera, seeding, pose = lab.camera, lab.seeding, lab.pose(kinematics.root)
    rng = np.random.default_rng([lab.seed, seed])
    box = Box(-4.0, camera.width_px + 4.0, -4.0, camera.height_px + 4.0, 1.25)
    p = seed_particles(box, seeding.density_ppp, seeding.diameter_px, seeding.diameter_std_px, rng)
    outline = pose.to_px(kinematics.shape("outline", pressure))
    polygon = np.array([0, camera.height_px - 1]) + outline * [1, -1]
    axes = np.arange(camera.width_px), np.arange(camera.height_px)
    mask = inside_polygon(polygon, *axes).astype(np.uint8)
    row = camera.height_px - 1 - p[1]
    light = seeding.peak * 255 * sheet_light(p[2], 1.0) * (p[3] / seeding.diameter_px) ** 2
    light[Body(mask, (polygon,)).holds(p[0], row)] = 0
    image = np.zeros(mask.shape, np.float32)
    add_particles(image, p[0], row, light, p[3])
    return expose(image, rng, bits=8, background=camera.background, read_noise=camera.read_noise)


def vortex_series(
    kinematics: Kinematics, times: np.ndarray, *, gain: float = 1.0, spacing: float = 1e-3
) -> xr.Dataset:
    """A tank-frame series: a Lamb-Oseen vortex at the dorsal side of the tip."""
    import shapely

    x, y = np.arange(-0.085, 0.125, spacing), np.arange(0.10, 0.285, spacing)
    gx, gy = np.meshgrid(x, y)
    names = ("outline", "tip", "tip_direction", "dorsal_direction", "bend")
    pressures = kinematics.law(np.clip(times, *kinematics.time))
    shapes = {n: np.array([kinematics.shape(n, p) for p in pressures])[:, None] for n in names}
    u, v, valid = [], [], []
    for k, t in enumerate(times):
        centre = shapes["tip"][k, 0] + 0.016 * shapes["dorsal_direction"][k, 0]
        dx, dy = gx - centre[0], gy - centre[1]
        r2 = np.maximum(dx**2 + dy**2, 1e-12)
        swirl = -gain * 0.012 * (0.3 + t) / (2 * np.pi * r2) * (1 - np.exp(-r2 / 0.006**2))
        outside = ~shapely.contains_xy(shapely.Polygon(shapes["outline"][k, 0]), gx, gy)
        u.append(np.where(outside, -swirl * dy, np.nan))
        v.append(np.where(outside, swirl * dx, np.nan))
        valid.append(outside)
    out = make_plane(x, y, np.array(u), np.array(v), time=times, valid=np.array(valid), **shapes)
    return out.assign_attrs(tip_width=kinematics.tip_width)
