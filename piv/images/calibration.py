"""Pixels to metres: scale and origin, lens distortion and tilt of the sheet.

Pixel positions here are those of results: x right of the centre of the left column, y **up** from
the centre of the bottom row. Metres are right-handed, x right, y up. Without a lens: m = (px -
origin) * scale. With one, px are turned to image rows, freed of distortion (OpenCV's model, Zhang
2000), taken by a homography to px of the sheet and then scaled.
"""

from dataclasses import asdict, dataclass
from pathlib import Path

import cv2
import numpy as np
import xarray as xr
from numpy import ndarray
from scipy import ndimage
from scipy.interpolate import RegularGridInterpolator

from piv.files.schema import JsonFormat
from piv.formats.plane_series import OUTLIER, UNCERTAIN, make_plane, usable, vectors_of
from piv.images.clock import interval_of, seconds
from piv.images.open_recording import row_to_y_px

_DISTORTION_COUNTS = (4, 5, 8, 12, 14)  # that OpenCV knows
MODELS_HELP = "distortion model: standard (5 coefficients) or rational (8, for very wide lenses)"
_FILE = JsonFormat("piv-calibration", "make it again with piv calibrate")
_NEWTON_STEPS = 8
# in area against the board: more is the lens model running away where it saw no target
_MAX_STRETCH = 3.0
# where undistorting misses by more, the lens model has no inverse: such points are absent
INVERSE_PX = 1e-3
_UNDISTORT = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 20, 1e-9)


@dataclass(frozen=True)
class Lens:
    """Distortion and view of the sheet, in OpenCV's px (y down); `size_px`: width, height."""

    size_px: tuple[int, int]
    camera_matrix: ndarray  # (3, 3)
    distortion: ndarray  # (4..14,)
    to_sheet: ndarray  # (3, 3) homography: undistorted px -> px of the sheet seen squarely, y down
    reprojection_rms_px: float
    views: int


@dataclass(frozen=True)
class Calibration:
    """Pixels to metres: m = (px - origin) * scale, after the lens where there is one.

    Parameters
    ----------
    scale_mm_per_px
        Size of a pixel in the sheet, mm.
    origin_x_px, origin_y_px
        Where x = y = 0 lies, px right and up from the centre of the lower left pixel.
    lens
        Distortion and view, as `piv calibrate --target` finds them.

    Raises
    ------
    ValueError
        Where the scale is not positive.

    Examples
    --------
    >>> piv.Calibration(0.1, 640, 0).to_m(np.array([[650.0, 20.0]]))
    array([[0.001, 0.002]])
    """

    scale_mm_per_px: float
    origin_x_px: float = 0.0
    origin_y_px: float = 0.0
    lens: Lens | None = None

    def __post_init__(self) -> None:
        if not (np.isfinite(self.scale_mm_per_px) and self.scale_mm_per_px > 0):
            raise ValueError(f"scale_mm_per_px must be positive, got {self.scale_mm_per_px}")

    def __repr__(self) -> str:
        lens = f", lens of {self.lens.reprojection_rms_px:.2g} px" if self.lens else ""
        origin = f"({self.origin_x_px:g}, {self.origin_y_px:g})"
        return f"Calibration({self.scale_mm_per_px:.6g} mm/px, origin {origin} px{lens})"

    @property
    def pixel(self) -> float:
        """Size of a pixel in the sheet, m."""
        return self.scale_mm_per_px * 1e-3

    @property
    def origin_px(self) -> ndarray:
        """Position of x = y = 0 in px of the sheet, (2,)."""
        return np.array([self.origin_x_px, self.origin_y_px])

    def to_m(self, points_px: ndarray) -> ndarray:
        """Positions (..., 2) in px (y up) to metres; NaN where the lens model has no inverse."""
        points = np.asarray(points_px, float)
        if self.lens is not None:
            points = _flip(_sheet(self.lens, _flip(points, self.lens)), self.lens)
        return (points - self.origin_px) * self.pixel

    def to_px(self, points_m: ndarray) -> ndarray:
        """Positions (..., 2) in metres to px (y up); inverse of `to_m`."""
        points = np.asarray(points_m, float) / self.pixel + self.origin_px
        if self.lens is None:
            return points
        return _flip(_unsheet(self.lens, _flip(points, self.lens)), self.lens)

    def displacement_m(self, points_px: ndarray, shift_px: ndarray) -> ndarray:
        """Displacements (..., 2) in px at mid positions to metres, from their mapped ends."""
        half = 0.5 * np.asarray(shift_px, float)
        return self.to_m(points_px + half) - self.to_m(points_px - half)

    def jacobian(self, points_px: ndarray) -> ndarray:
        """d(m)/d(px), (..., 2, 2), by central differences over one pixel."""
        steps = [np.array([0.5, 0.0]), np.array([0.0, 0.5])]
        return np.stack(
            [self.to_m(points_px + s) - self.to_m(points_px - s) for s in steps], axis=-1
        )


def from_points(
    first_px: tuple[float, float],
    second_px: tuple[float, float],
    distance_mm: float,
    origin_px: tuple[float, float] = (0.0, 0.0),
) -> Calibration:
    """Scale from two points in px whose distance in mm is known."""
    length = float(np.hypot(second_px[0] - first_px[0], second_px[1] - first_px[1]))
    if not length > 0 or not distance_mm > 0:
        raise ValueError(
            f"two different points and a positive distance are needed, got {length:g} px, "
            f"{distance_mm:g} mm"
        )
    return Calibration(distance_mm / length, *origin_px)


def _flip(points: ndarray, lens: Lens) -> ndarray:
    return np.stack([points[..., 0], row_to_y_px(points[..., 1], lens.size_px[1])], axis=-1)


def _project(matrix: ndarray, points: ndarray) -> ndarray:
    (a, b, c), (d, e, f), (g, h, i) = matrix
    x, y = points[..., 0], points[..., 1]
    depth = g * x + h * y + i
    return np.stack([(a * x + b * y + c) / depth, (d * x + e * y + f) / depth], axis=-1)


def _sheet(lens: Lens, points: ndarray) -> ndarray:
    seen = np.ascontiguousarray(points.reshape(-1, 2), np.float64)
    matrix = lens.camera_matrix
    ideal = cv2.undistortPoints(
        seen[:, None], matrix, lens.distortion, P=matrix, criteria=_UNDISTORT
    )[:, 0]
    # OpenCV's fixed-point iteration crawls or diverges under strong distortion: Newton steps end
    # it.
    steps = np.array([[0.05, 0.0], [0.0, 0.05]])
    for _ in range(_NEWTON_STEPS):
        wrong = _distort(lens, ideal) - seen
        (xx, yx), (xy, yy) = [
            ((_distort(lens, ideal + h) - _distort(lens, ideal - h)) / 0.1).T for h in steps
        ]
        det = xx * yy - xy * yx
        det[np.abs(det) < 1e-3] = np.inf  # at a turning point: no step
        wx, wy = wrong.T
        ideal = ideal - np.stack([yy * wx - xy * wy, xx * wy - yx * wx], 1) / det[:, None]
    lost = ~(np.abs(_distort(lens, ideal) - seen).max(axis=1) < INVERSE_PX)
    ideal[lost] = np.nan
    return _project(lens.to_sheet, ideal).reshape(points.shape)


def _distort(lens: Lens, ideal: ndarray) -> ndarray:
    """OpenCV's model without sensor tilt; cv2.projectPoints is 50 times slower."""
    k1, k2, p1, p2, k3, k4, k5, k6 = np.pad(lens.distortion, (0, 8))[:8]
    x, y = _project(np.linalg.inv(lens.camera_matrix), ideal).T
    r2 = x * x + y * y
    radial = (1 + r2 * (k1 + r2 * (k2 + r2 * k3))) / (1 + r2 * (k4 + r2 * (k5 + r2 * k6)))
    bent_x = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
    bent_y = y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
    return _project(lens.camera_matrix, np.stack([bent_x, bent_y], axis=1))


def _unsheet(lens: Lens, points: ndarray) -> ndarray:
    flat = _project(np.linalg.inv(lens.to_sheet), points).reshape(-1, 2)
    return _distort(lens, flat).reshape(points.shape)


def save_calibration(calibration: Calibration, path: str | Path) -> None:
    """Write the small JSON file."""
    _FILE.write(Path(path), asdict(calibration))


def load_calibration(path: str | Path) -> Calibration:
    """Read a calibration that `piv calibrate` wrote.

    Parameters
    ----------
    path
        The file, .json.

    Returns
    -------
    Calibration
        Its scale, origin and lens.

    Raises
    ------
    ValueError, FileNotFoundError
        Where it is another thing, or not there.

    Examples
    --------
    >>> from piv.images.calibration import save_calibration
    >>> save_calibration(piv.Calibration(0.1), "calibration.json")
    >>> piv.load_calibration("calibration.json").scale_mm_per_px
    0.1
    """
    try:
        whole = _FILE.read(Path(path))
        lens = whole.get("lens")
        if lens is not None:
            count = np.size(lens["distortion"])
            if count not in _DISTORTION_COUNTS:
                raise ValueError(
                    f"a lens has 4, 5, 8, 12 or 14 distortion coefficients, not {count}"
                )
            camera, to_sheet = (
                np.array(lens[k], float).reshape(3, 3) for k in ("camera_matrix", "to_sheet")
            )
            distortion = np.array(lens["distortion"], float).ravel()
            width, height, views = map(int, (*lens["size_px"], lens["views"]))
            lens = Lens(
                (width, height),
                camera,
                distortion,
                to_sheet,
                float(lens["reprojection_rms_px"]),
                views,
            )
        scale, x0, y0 = (float(whole[k]) for k in ("scale_mm_per_px", "origin_x_px", "origin_y_px"))
        return Calibration(scale, x0, y0, lens)
    except (KeyError, TypeError, ValueError, IndexError) as error:
        raise ValueError(f"{path}: not a calibration file ({error})") from error


def calibrate_plane(
    plane_px: xr.Dataset,
    calibration: Calibration,
    interval: float | None = None,
    rate: float | None = None,
) -> xr.Dataset:
    """Take a plane or series from px to m, m/s and s.

    Without a lens every variable is scaled. With one, the vectors and their uncertainties are
    sampled (linearly) on a regular grid in the sheet: a vector is absent where one of the four
    around it is, and uncertain where one of them is.

    Parameters
    ----------
    plane_px
        A plane or series in px.
    calibration
        Scale, origin and lens.
    interval
        s between the exposures of a pair, where the file does not state it.
    rate
        Pairs per second, where the file has no times.

    Returns
    -------
    xarray.Dataset
        In SI.

    Raises
    ------
    ValueError
        Where interval or rate lack, or contradict the file.

    Examples
    --------
    >>> field = piv.correlate("docs/tutorials/frames", window=24)
    >>> metres = piv.calibrate_plane(field, piv.Calibration(0.1), interval=0.002)
    >>> bool(np.allclose(metres["u"], field["u"] * 1e-4 / 0.002, equal_nan=True))
    True
    """
    interval = interval_of(plane_px, interval)
    names = ("scale_mm_per_px", "origin_x_px", "origin_y_px")
    attrs = plane_px.attrs | {name: getattr(calibration, name) for name in names}
    attrs["interval"] = interval
    time = seconds(plane_px, interval, rate) if "time" in plane_px.dims else None
    if calibration.lens is None:
        plane = _scaled(plane_px, calibration, interval)
    else:
        plane = _sampled(plane_px, calibration, interval)
    if time is not None:
        plane = plane.assign_coords(time=("time", time, {"units": "s"}))
    return plane.assign_attrs(attrs)


# SI unit of what is in px and frames, and the powers of the pixel and of the interval in it
_IN_SI = {
    "px": ("m/s", 1, -1),
    "px/frame": ("m/s", 1, -1),
    "px/s": ("m/s", 1, 0),
    "px²": ("m²/s²", 2, -2),
    "1/frame": ("1/s", 0, -1),
    "1/frame²": ("1/s²", 0, -2),
}


def _scaled(plane_px: xr.Dataset, calibration: Calibration, interval: float) -> xr.Dataset:
    """Convert every variable to SI by its unit."""
    pixel = calibration.pixel
    plane = plane_px.copy()
    for axis, origin in zip("xy", calibration.origin_px, strict=True):
        plane[axis] = (axis, (plane[axis].values - origin) * pixel, {"units": "m"})
    for name, variable in plane_px.data_vars.items():
        unit, length, time = _IN_SI.get(str(variable.attrs.get("units")), ("", 0, 0))
        if unit:
            attrs = variable.attrs | {"units": unit}
            if "correlation_length" in attrs:
                attrs["correlation_length"] *= pixel
            values = variable.values * (pixel**length * interval**time)
            plane[name] = (variable.dims, values, attrs)
    return plane


def _sampled(plane_px: xr.Dataset, calibration: Calibration, interval: float) -> xr.Dataset:
    """The vectors through the lens onto a regular grid in the sheet."""
    x, y = plane_px["x"].values.astype(float), plane_px["y"].values.astype(float)
    order = ("y", "x") if "time" not in plane_px.dims else ("time", "y", "x")
    fields = {str(n): f.transpose(*order).values for n, f in vectors_of(plane_px).items()}
    spread = {n: fields[n] for n in ("u_std", "v_std") if n in fields}
    flag, valid = fields.get("flag"), fields["valid"].astype(bool)
    more: dict[str, ndarray] = {}
    x_m, y_m = _sheet_grid(calibration, x, y)
    at = calibration.to_px(np.stack(np.meshgrid(x_m, y_m), axis=-1))
    known = usable(plane_px).transpose(*order).values
    ok, sure = (_sample(whole.astype(float), x, y, at) > 1 - 1e-9 for whole in (known, valid))
    ok &= _same(calibration, at, x_m, y_m)
    shift = [_sample(np.where(known, fields[n], 0.0), x, y, at) for n in ("u", "v")]
    moved = calibration.displacement_m(at, np.stack(shift, axis=-1)) / interval
    ok &= np.isfinite(moved).all(axis=-1)
    u, v = (np.where(ok, moved[..., k], np.nan) for k in range(2))
    if len(spread) == 2:
        var = [_sample(np.where(known, spread[n], 0.0), x, y, at) ** 2 for n in ("u_std", "v_std")]
        j2 = (calibration.jacobian(at) / interval) ** 2
        for k, n in enumerate(("u_std", "v_std")):
            more[n] = np.where(ok, np.sqrt(j2[..., k, 0] * var[0] + j2[..., k, 1] * var[1]), np.nan)
    if flag is not None:
        flag = _sample(flag, x, y, at, method="nearest").astype(np.uint8)
        flag[flag == UNCERTAIN] = OUTLIER
        flag[ok & ~sure] = UNCERTAIN
        more["flag"] = flag
    time = plane_px["time"].values if "time" in plane_px.dims else None
    return make_plane(x_m, y_m, u, v, time=time, valid=ok & sure, **more)


def _sheet_grid(calibration: Calibration, x: ndarray, y: ndarray) -> list[ndarray]:
    step = float(x[1] - x[0]) * calibration.pixel
    edge = calibration.to_m(np.stack(np.meshgrid(x, y), axis=-1))
    low, high = np.nanmin(edge.reshape(-1, 2), axis=0), np.nanmax(edge.reshape(-1, 2), axis=0)
    return [a + step * np.arange(int((b - a) / step) + 1) for a, b in zip(low, high, strict=True)]


def _same(calibration: Calibration, at: ndarray, x_m: ndarray, y_m: ndarray) -> ndarray:
    """Where px -> m gives the grid point back, within MAX_STRETCH of the board's scale."""
    miss = calibration.to_m(at) - np.stack(np.meshgrid(x_m, y_m), axis=-1)
    same = np.abs(miss).max(axis=-1) < INVERSE_PX * calibration.pixel
    stretch = np.abs(np.linalg.det(calibration.jacobian(at))) / calibration.pixel**2
    return same & (stretch < _MAX_STRETCH) & (stretch > 1 / _MAX_STRETCH)


def _sample(
    values: ndarray, x: ndarray, y: ndarray, at: ndarray, method: str = "linear"
) -> ndarray:
    stack = np.moveaxis(values.reshape(-1, *values.shape[-2:]), 0, -1)
    field = RegularGridInterpolator(
        (y, x), stack, method=method, bounds_error=False, fill_value=0.0
    )
    return np.moveaxis(field(at[..., ::-1]), -1, 0).reshape(*values.shape[:-2], *at.shape[:-1])


def rectify_image(image: ndarray, calibration: Calibration) -> ndarray:
    """The frame as a square view of the sheet, same shape, dtype and scale; outside is 0.

    Cubic splines, not `cv2.remap`, whose coordinates are rounded to 1/32 px. Afterwards the
    calibration without its lens holds.
    """
    lens = calibration.lens
    if lens is None:
        raise ValueError("this calibration has no lens: its images need no rectification")
    rows, columns = image.shape
    if (columns, rows) != tuple(lens.size_px):
        raise ValueError(
            f"the image is {columns}x{rows} px, the calibration is for "
            f"{lens.size_px[0]}x{lens.size_px[1]} px"
        )
    row, column = np.mgrid[:rows, :columns].astype(float)
    seen = _unsheet(lens, np.stack([column, row], axis=-1))
    flat = ndimage.map_coordinates(
        image.astype(np.float32), [seen[..., 1], seen[..., 0]], order=3, cval=0.0
    )
    top = np.iinfo(image.dtype).max if np.issubdtype(image.dtype, np.integer) else np.inf
    return np.clip(np.round(flat) if np.isfinite(top) else flat, 0, top).astype(image.dtype)
