"""Lens and sheet from pictures of a flat target: chessboard or ChArUco board."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy import ndarray

from piv.images.calibration import Calibration, Lens

_MODELS = {"standard": 0, "rational": cv2.CALIB_RATIONAL_MODEL}
_MIN_CORNERS = 8  # of a view: fewer leave its pose loose


@dataclass(frozen=True)
class Target:
    """A board of `rows` x `columns` squares of `square_m`; with `marker_m` a ChArUco board."""

    rows: int
    columns: int
    square_m: float
    marker_m: float | None = None
    dictionary: str = "DICT_4X4_1000"

    def __post_init__(self) -> None:
        if self.rows < 3 or self.columns < 3 or not self.square_m > 0:
            raise ValueError(f"a target needs at least 3 x 3 squares of positive size, got {self}")
        if self.marker_m is not None and not 0 < self.marker_m < self.square_m:
            raise ValueError(
                f"markers ({self.marker_m} m) must be smaller than squares ({self.square_m} m)"
            )
        if not hasattr(cv2.aruco, self.dictionary):
            raise ValueError(
                f"unknown ArUco dictionary {self.dictionary!r}, for example DICT_4X4_1000"
            )


def find_corners(image: ndarray, target: Target) -> tuple[ndarray, ndarray]:
    """Inner corners of the target in one 8-bit frame.

    Returns (corners (n, 2) in image px, y down; positions (n, 3) on the board in m, z = 0), empty
    where no target is seen. A ChArUco board is tried in both layouts (OpenCV's before and since
    4.6, which begin with another square) and the one with more corners is taken.
    """
    if image.dtype == np.uint16:
        image = cv2.convertScaleAbs(image, alpha=255 / max(int(image.max()), 1))
    if target.marker_m is None:
        size = (target.columns - 1, target.rows - 1)
        complete, corners = cv2.findChessboardCornersSB(image, size, flags=cv2.CALIB_CB_ACCURACY)
        if not complete:
            return np.empty((0, 2)), np.empty((0, 3))
        grid = (
            np.mgrid[: target.rows - 1, : target.columns - 1][::-1].reshape(2, -1).T
            * target.square_m
        )
        return corners.reshape(-1, 2).astype(float), np.column_stack([grid, np.zeros(len(grid))])
    dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, target.dictionary))
    best = np.empty((0, 2)), np.empty((0, 3))
    for legacy in (False, True):
        size = (target.columns, target.rows)
        board = cv2.aruco.CharucoBoard(size, target.square_m, target.marker_m, dictionary)
        board.setLegacyPattern(legacy)
        corners, ids, _, _ = cv2.aruco.CharucoDetector(board).detectBoard(image)
        if ids is not None and len(ids) > len(best[0]):
            places = np.asarray(board.getChessboardCorners(), float)[ids.ravel()]
            best = corners.reshape(-1, 2).astype(float), places
    return best


def calibrate_target(
    views: Sequence[ndarray],
    target: Target,
    *,
    model: str = "standard",
    origin_px: tuple[float, float] = (0.0, 0.0),
) -> tuple[Calibration, list[int]]:
    """Calibration from frames of a target, the first of which shows it in the light sheet.

    The sheet keeps the direction of the image's rows at the board and the scale there; distortion
    and tilt are taken out. With one view only the tilt is found, not the lens. Returns the
    calibration and the views used; views with fewer than 8 corners are left out. `origin_px`: of
    the rectified image, y up.
    """
    if model not in _MODELS:
        raise ValueError(f"lens model must be one of {', '.join(_MODELS)}, got {model!r}")
    if not views or len({v.shape for v in views}) != 1:
        raise ValueError("the target's pictures must be at least one, all of the same size")
    matches = [find_corners(v, target) for v in views]
    used = [k for k, (corners, _) in enumerate(matches) if len(corners) >= _MIN_CORNERS]
    if 0 not in used:
        raise ValueError(
            f"picture 0, which shows the target in the sheet: {len(matches[0][0])} corners "
            "found; check rows, columns, marker size and dictionary"
        )
    rows, columns = views[0].shape
    image_points = [matches[k][0].astype(np.float32) for k in used]
    board_points = [matches[k][1].astype(np.float32) for k in used]
    if len(used) > 1:
        rms, matrix, distortion, _, _ = cv2.calibrateCamera(
            board_points, image_points, (columns, rows), None, None, flags=_MODELS[model]
        )
    else:
        matrix, distortion, rms = np.diag([columns, columns, 1.0]), np.zeros(5), np.nan
        matrix[:2, 2] = (columns - 1) / 2, (rows - 1) / 2
    corners, places = matches[0]
    straight = cv2.undistortPoints(
        corners.reshape(-1, 1, 2), matrix, distortion, P=matrix, criteria=(3, 200, 1e-12)
    ).reshape(-1, 2)
    to_board, _ = cv2.findHomography(straight, places[:, :2])
    if not np.isfinite(rms):
        back = cv2.perspectiveTransform(places[None, :, :2], np.linalg.inv(to_board))[0]
        rms = float(np.sqrt(np.mean(np.sum((back - straight) ** 2, axis=1))))
    to_sheet, scale = _square_view(to_board, straight.mean(axis=0))
    lens = Lens((columns, rows), matrix, np.ravel(distortion), to_sheet, float(rms), len(used))
    return Calibration(1e3 * scale, *origin_px, lens), used


def _square_view(to_board: ndarray, centre: ndarray) -> tuple[ndarray, float]:
    """(undistorted px -> square px, m per px): the board's plane, placed at `centre`."""
    here = _apply(to_board, centre)
    right, below = np.array([0.5, 0.0]), np.array([0.0, 0.5])
    along = _apply(to_board, centre + right) - _apply(to_board, centre - right)
    down = _apply(to_board, centre + below) - _apply(to_board, centre - below)
    area = along[0] * down[1] - along[1] * down[0]
    scale = float(np.sqrt(abs(area)))  # of the board per px, the mean over directions
    turn = np.array([[along[0], along[1]], [-along[1], along[0]]]) / np.hypot(*along)
    if area < 0:  # the board is seen from behind
        turn[1] *= -1
    affine = np.eye(3)
    affine[:2, :2] = turn / scale
    affine[:2, 2] = centre - affine[:2, :2] @ here
    return affine @ to_board, scale


def _apply(matrix: ndarray, point: ndarray) -> ndarray:
    end = matrix @ np.array([point[0], point[1], 1.0])
    return end[:2] / end[2]
