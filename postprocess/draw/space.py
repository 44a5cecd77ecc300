"""The flow in space: a surface of equal Q around the bodies, and the laser sheet through it."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import pyvista as pv
from matplotlib.colors import LinearSegmentedColormap
from scipy.spatial import cKDTree

from postprocess.draw.style import BODY, INK, MM

_SIZE = (760, 700)  # px; even, as films want it
_ANGLE_DEG, _RISE_DEG = 20.0, -12.0  # of view; seen from below, where the tip's vortex is
_SHEET = "#4fa864"  # of the laser
# as in the pictures of the sheet, but for a grey that is seen on a light ground
_MAP = LinearSegmentedColormap.from_list(
    "space", ["#40198c", "#7d6fb8", "#c9d2da", "#ee9a3a", "#a84300"]
)
_SHADE = [0.8, 0.5, 0.12, 0.0, 0.12, 0.5, 0.8]  # opacity of the sheet over the vorticity's range
_LIT: dict[str, Any] = {"smooth_shading": True, "ambient": 0.35, "diffuse": 0.7, "specular": 0.2}
_LIGHTS = ((1.0, 2.0, 2.0, 0.75), (-2.0, 0.5, 1.5, 0.35))  # direction from the camera, intensity


@dataclass(frozen=True)
class View:
    """What all pictures of a run have in common; `box`: low and high x, y, z in m."""

    box: tuple[float, ...]
    q: float  # 1/s², of the surface
    vorticity_limit: float  # 1/s
    off_wall: float  # m: nearer a wall, in its layer, no surface is drawn
    bar: float = 0.02  # m, of the scale bar


class Stage:
    """An off-screen window that is filled anew for each picture."""

    def __init__(self, view: View) -> None:
        self.view = view
        self.plotter = pv.Plotter(off_screen=True, window_size=list(_SIZE), lighting="none")
        self.plotter.set_background("white", top="#e6eef5")  # type: ignore[arg-type]
        for *place, power in _LIGHTS:
            light = pv.Light(position=place, light_type="camera light", intensity=power)
            self.plotter.add_light(light)
        self.plotter.enable_anti_aliasing("ssaa")
        self.plotter.camera.view_angle = _ANGLE_DEG

    def picture(
        self, water: pv.UnstructuredGrid, walls: pv.UnstructuredGrid, turn_deg: float
    ) -> np.ndarray:
        """The picture (row, column, RGB), seen from `turn_deg` beside the sheet's normal."""
        self.plotter.clear_actors()
        smooth = walls.extract_surface(algorithm="dataset_surface")
        self._add(smooth.compute_normals(split_vertices=True), color=BODY, **_LIT)
        shown: dict[str, Any] = {"scalars": "vorticity", "component": 2, "cmap": _MAP}
        shown["clim"] = (-self.view.vorticity_limit, self.view.vorticity_limit)
        fields = water.cell_data_to_point_data()
        apart, _ = cKDTree(walls.points).query(fields.points)
        fields["q"] = np.where(apart < self.view.off_wall, 0.0, fields["q"])
        vortex = fields.contour([self.view.q], scalars="q")
        if vortex.n_cells:
            vortex = vortex.clean().smooth_taubin(n_iter=20, pass_band=0.1)
            self._add(vortex, show_scalar_bar=False, **shown, **_LIT)
        self._sheet(fields, shown)
        self._look(turn_deg)
        self.plotter.render()
        return np.asarray(self.plotter.screenshot(return_img=True))[..., :3]

    def _add(self, mesh: pv.DataSet, **more: Any) -> None:
        self.plotter.add_mesh(mesh, render=False, **more)

    def _sheet(self, fields: pv.UnstructuredGrid, shown: dict[str, Any]) -> None:
        """The laser sheet as a pane with the vorticity in it, its edge and a scale bar."""
        x0, x1, y0, y1 = self.view.box[:4]
        corners = np.array([[x0, y0, 0], [x1, y0, 0], [x1, y1, 0], [x0, y1, 0]], float)
        self._add(pv.Rectangle(corners[:3]), color=_SHEET, opacity=0.07, lighting=False)
        edge = pv.lines_from_points(corners, close=True)
        self._add(edge, color=_SHEET, line_width=2, lighting=False)
        # beside the plane of symmetry, where the mesh ends
        cut = fields.slice(normal="z", origin=(0, 0, 1e-5)).clip_box(
            (x0, x1, y0, y1, -1, 1), invert=False
        )
        if cut.n_cells:
            self._add(cut, opacity=_SHADE, show_scalar_bar=False, lighting=False, **shown)
        bar = np.array([x0, y0, 0]) + 0.06 * (x1 - x0) * np.array([1, 1, 0])
        ends = np.array([bar, bar])
        ends[1, 0] += self.view.bar
        self._add(pv.Line(*ends), color=INK, line_width=4, lighting=False)
        self.plotter.add_point_labels(
            ends.mean(axis=0)[None] - [0, 1e-3, 0], [f"{self.view.bar * MM:g} mm"],
            text_color=INK, font_size=20, bold=False, shape=None, show_points=False,
            always_visible=True, justification_horizontal="center",
            justification_vertical="top", render=False,
        )  # fmt: skip

    def _look(self, turn_deg: float) -> None:
        x0, x1, y0, y1 = self.view.box[:4]
        centre = np.array([(x0 + x1) / 2, (y0 + y1) / 2, 0.0])
        turn, rise = np.radians([turn_deg, _RISE_DEG])
        along = np.array([np.sin(turn) * np.cos(rise), np.sin(rise), np.cos(turn) * np.cos(rise)])
        radius = 0.5 * max(y1 - y0, (x1 - x0) * _SIZE[1] / _SIZE[0])
        away = 1.15 * radius / np.tan(np.radians(_ANGLE_DEG / 2))
        self.plotter.camera_position = [centre + away * along, centre, (0, 1, 0)]
        self.plotter.reset_camera_clipping_range()

    def close(self) -> None:
        """Give the window's memory back."""
        self.plotter.close()
