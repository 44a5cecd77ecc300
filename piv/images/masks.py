"""Masks: bool arrays in image order, True = body (takes no part in correlation)."""

import math
from pathlib import Path

import cv2
import numpy as np
import xarray as xr
from numpy import ndarray

from piv.compiled import compiled
from piv.formats.user_tables import read_table
from piv.images.open_recording import row_to_y_px

# of particle images to a body: below it a threshold would cut the light sheet's own shade
MIN_CONTRAST = 1.6
MOST = 0.99  # of the picture: a larger mask leaves nothing to correlate, and is a photograph
OPENED_PX, CLOSED_PX = 15, 25  # width of bridges and of gaps that are no part of a body's shape
SUBPIXEL_BITS = 6  # fixed-point digits of polygon corners in OpenCV


def polygon_mask(polygon_px: ndarray, shape: tuple[int, int]) -> ndarray:
    """Body inside a polygon, its edge included.

    `polygon_px` (n, 2): x right and y up from the centre of the bottom row of pixels, as in every
    result in px.
    """
    polygon = np.asarray(polygon_px, float)
    if (
        polygon.ndim != 2
        or polygon.shape[1] != 2
        or len(polygon) < 3
        or not np.isfinite(polygon).all()
    ):
        raise ValueError(
            f"a mask polygon needs at least 3 finite corners (n, 2), got shape {polygon.shape}"
        )
    corners = np.column_stack([polygon[:, 0], row_to_y_px(polygon[:, 1], shape[0])])
    limit = 2 ** (31 - SUBPIXEL_BITS) - 1
    fixed = np.round(np.clip(corners, -limit, limit) * 2**SUBPIXEL_BITS).astype(np.int32)
    mask = np.zeros(shape, np.uint8)
    cv2.fillPoly(mask, [fixed], 1, lineType=cv2.LINE_8, shift=SUBPIXEL_BITS)
    return mask.astype(bool)


def inside_polygon(polygon: ndarray, x: ndarray, y: ndarray, near: float = 0.0) -> ndarray:
    """Which points lie within a closed polygon (corner, axis) or `near` it: even-odd rule.

    A grid of axes x and y gives (y, x); points x (n, 1) and y (n,) give (n, 1).
    """
    corners, x, y = (np.ascontiguousarray(a, float) for a in (polygon, np.atleast_2d(x), y))
    return _inside_polygon(corners, x, y, float(near))


@compiled
def _inside_polygon(polygon, x, y, near):
    inside = np.zeros((y.size, x.shape[1]), np.bool_)
    beside = inside.copy()
    for k in range(len(polygon)):
        (x0, y0), (x1, y1) = polygon[k - 1], polygon[k]
        dx, dy = x1 - x0, y1 - y0
        square = max(dx * dx + dy * dy, 1e-300)
        for j in range(y.size):
            line = x[j if len(x) > 1 else 0]
            up = y[j] - y0
            if (y0 <= y[j]) != (y1 <= y[j]):
                inside[j] ^= line < x0 + up * (dx / dy)
            if near > 0 and min(y0, y1) - near <= y[j] <= max(y0, y1) + near:
                for i in range(line.size):
                    if min(x0, x1) - near <= line[i] <= max(x0, x1) + near:
                        right = line[i] - x0
                        part = min(max((right * dx + up * dy) / square, 0.0), 1.0)
                        beside[j, i] |= math.hypot(right - part * dx, up - part * dy) <= near
    return inside | beside


def read_polygon(path: str | Path) -> ndarray:
    """Corners x, y (px, y up) from a CSV file of two numbers a line, with or without names."""
    table = read_table(Path(path), "x,y in px", names=("x", "y"))
    width = len((table.rows or [[]])[0])
    if width != 2 or len(table.rows) < 3:
        raise ValueError(
            f"{path}: has {len(table.rows)} rows of {width} numbers; give x and y in px of at least"
            " 3 corners"
        )
    return table.numbers()


def read_mask(path: str | Path, shape: tuple[int, int]) -> ndarray:
    """A static mask for frames of `shape` from a polygon (.csv, .txt) or an image (not black)."""
    path = Path(path)
    if not path.is_file():
        raise FileNotFoundError(
            f"{path}: no such file; a mask is an image, a folder of images or a polygon (.csv)"
        )
    if path.suffix.lower() in (".csv", ".txt"):
        return polygon_mask(read_polygon(path), shape)
    image = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    if image is None:
        raise ValueError(
            f"{path}: not readable as an image; a mask is an image or a polygon (.csv)"
        )
    if image.shape != shape:
        raise ValueError(
            f"{path}: the mask is {image.shape[1]}x{image.shape[0]} px, the frames are "
            f"{shape[1]}x{shape[0]} px; "
            "make it of one of these frames"
        )
    return not_whole(image > 0, path)


def not_whole(mask: ndarray, name: object) -> ndarray:
    """The mask; ValueError with its name where it leaves nothing of the picture."""
    if (share := mask.mean()) > MOST:
        raise ValueError(
            f"{name}: masks {share:.1%} of the picture; a mask is black but for the body"
        )
    return mask


def outline_px(outline: ndarray, pixel: float, origin_px: tuple[float, float]) -> ndarray:
    """Outline (..., 2) in m to px (of size `pixel`, m) right and up from the lower left pixel."""
    return np.asarray(outline, float) / pixel + np.asarray(origin_px, float)


def outline_masks(
    series: xr.Dataset,
    times: ndarray,
    pixel: float,
    origin_px: tuple[float, float],
) -> list[list[ndarray]]:
    """Corner lists in px, one list of bodies per time, from the `outline` of a file.

    The outline is interpolated linearly in time; a time outside the series raises ValueError (a
    frozen body would be a guess). Draw with `polygons_mask`.
    """
    if "outline" not in series:
        raise ValueError("the file has no variable 'outline' to make masks from")
    outline = series["outline"]
    if "finger" not in outline.dims:
        outline = outline.expand_dims("finger", 1)
    outline = outline.transpose("time", "finger", "point", "axis")
    first, last = float(series["time"].min()), float(series["time"].max())
    slack = 1e-9 + 1e-6 * (last - first)
    if times.min() < first - slack or times.max() > last + slack:
        raise ValueError(
            f"the outline covers {first:g} to {last:g} s, the recording {times.min():g} to "
            f"{times.max():g} s"
        )
    if outline.sizes["time"] > 1:
        outline = outline.interp(time=np.clip(times, first, last))
    return [list(frame) for frame in outline_px(outline.values, pixel, origin_px)]


def polygons_mask(polygons_px: list[ndarray], shape: tuple[int, int]) -> ndarray:
    """Body inside any of several polygons."""
    mask = np.zeros(shape, bool)
    for polygon in polygons_px:
        mask |= polygon_mask(polygon, shape)
    return mask


def dark_body(
    image: ndarray,
    *,
    threshold: float | None = None,
    smooth_px: float = 6.0,
    min_area: float = 0.002,
    grow_px: int = 3,
) -> ndarray:
    """The dark body in a frame of bright particles, by threshold and morphology.

    Gaps between particles are closed over (grey closing by a disc of `smooth_px`, which keeps the
    body's edge) and the image is cut at `threshold` (grey levels of the closed image; without one,
    the geometric mean of its darkest part and its median). Thin bridges are opened, gaps closed,
    regions below `min_area` (fraction of the image) dropped, holes filled and the rest grown by
    `grow_px`. Raises ValueError where no region is left: a mask that vanishes would let the body be
    correlated.
    """
    grey = image.astype(np.float32)
    closed = cv2.morphologyEx(grey, cv2.MORPH_CLOSE, _disc(round(smooth_px)))
    smooth = cv2.GaussianBlur(closed, (0, 0), max(smooth_px / 3, 0.5))
    if threshold is None:
        dark, middle = np.percentile(smooth, [100 * min_area, 50])
        if not middle > MIN_CONTRAST * max(dark, 1.0):
            raise ValueError(
                f"no dark body: the darkest part of the frame has {dark:.3g} grey levels, the "
                f"median {middle:.3g}; "
                "give `threshold`"
            )
        threshold = float(np.sqrt(max(dark, 1.0) * middle))
    body: ndarray = (smooth < threshold).astype(np.uint8)
    # The frame's edge is no edge of the body: pad with what is there.
    pad = 2 * CLOSED_PX
    body = cv2.copyMakeBorder(body, pad, pad, pad, pad, cv2.BORDER_REPLICATE)
    body = cv2.morphologyEx(body, cv2.MORPH_OPEN, _disc(OPENED_PX // 2))
    body = cv2.morphologyEx(body, cv2.MORPH_CLOSE, _disc(CLOSED_PX // 2))
    body = body[pad:-pad, pad:-pad]
    count, labels, stats, _ = cv2.connectedComponentsWithStats(
        np.ascontiguousarray(body), connectivity=4
    )
    large = [k for k in range(1, count) if stats[k, cv2.CC_STAT_AREA] >= min_area * body.size]
    if not large:
        raise ValueError(
            f"no dark region of at least {min_area:g} of the image is below grey level "
            f"{threshold:.3g}; "
            "give `threshold`, or a lower `min_area`"
        )
    body = np.isin(labels, large).astype(np.uint8)
    contours, _ = cv2.findContours(body, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    cv2.drawContours(body, contours, -1, 1, cv2.FILLED)
    # The blur moves the threshold's edge into the body's dark side: growing gives it back, with a
    # margin.
    body = cv2.dilate(body, _disc(grow_px))
    if body.mean() > MOST:
        raise ValueError(
            f"what is below grey level {threshold:.3g} masks the whole image; give a lower "
            "`threshold`"
        )
    return body.astype(bool)


def _disc(radius: int) -> ndarray:
    size = 2 * max(int(radius), 0) + 1
    return cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (size, size))
