"""Calibration against targets drawn with known lenses, and a real ChArUco recording."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
import xarray as xr
from hypothesis import given
from hypothesis import strategies as st

from docs.evidence.small_scene import shared_data
from piv.formats.plane_series import UNCERTAIN, VALID, usable
from piv.images.calibration import (
    Calibration,
    calibrate_plane,
    from_points,
    load_calibration,
    rectify_image,
    save_calibration,
)
from piv.images.calibration_target import Target, calibrate_target, find_corners
from piv.images.open_recording import open_recording, row_to_y_px

MATRIX = np.array([[900.0, 0, 319.5], [0, 900.0, 239.5], [0, 0, 1]])
BARREL = np.array([-0.25, 0.08, 0.001, -0.0015, 0.0])
SIZE = (640, 480)
BOARD = Target(7, 10, 0.01)


def shared(name: str) -> Path:
    folder = shared_data()
    if folder is None or not (folder / name).is_dir():
        pytest.skip("shared data are absent")
    return folder / name


def draw_board(rotation, shift) -> np.ndarray:
    """A chessboard through the lens, by casting each (sub)pixel onto the board."""
    over = 2
    fine = (np.mgrid[: SIZE[1] * over, : SIZE[0] * over][::-1].reshape(2, -1).T + 0.5) / over - 0.5
    rays = cv2.undistortPoints(fine[:, None], MATRIX, BARREL, criteria=(3, 15, 1e-9))[:, 0]
    turn, _ = cv2.Rodrigues(np.array(rotation, float))
    ahead = np.column_stack([rays, np.ones(len(rays))]) @ turn  # in board axes
    eye = -turn.T @ np.array(shift, float)
    at = eye[:2] - ahead[:, :2] * (eye[2] / ahead[:, 2])[:, None]
    cell = np.floor(at / BOARD.square_m).astype(int) + 1  # corner (0, 0) is the first inner corner
    inside = (cell >= 0).all(axis=1) & (cell[:, 0] < BOARD.columns) & (cell[:, 1] < BOARD.rows)
    white = ((cell.sum(axis=1) % 2) == 1) | ~inside
    picture = np.where(white, 220.0, 30.0).reshape(SIZE[1], over, SIZE[0], over).mean(axis=(1, 3))
    return cv2.GaussianBlur(picture, (0, 0), 0.7).astype(np.uint8)


@pytest.fixture(scope="module")
def calibrated():
    poses = [
        ((0.0, 0.0, 0.0), (-0.04, -0.025, 0.16)),  # in the sheet, square to the camera
        ((0.35, 0.0, 0.05), (-0.05, -0.03, 0.18)),
        ((-0.35, 0.1, 0.0), (-0.03, -0.025, 0.18)),
        ((0.0, 0.4, 0.0), (-0.045, -0.02, 0.19)),
        ((0.1, -0.4, 0.1), (-0.035, -0.03, 0.19)),
        ((0.2, 0.2, -0.2), (-0.04, -0.02, 0.20)),
    ]
    return calibrate_target([draw_board(*p) for p in poses], BOARD, origin_px=(100.0, 50.0))


def test_known_lens_is_recovered(calibrated):
    calibration, used = calibrated
    assert used == list(range(6))
    # corner detection on 8-bit pictures reaches a few 0.01 px
    assert calibration.lens.reprojection_rms_px < 0.1
    # Scale at the middle of the board: 0.16 m / 900 px, but the barrel is relative to the optical
    # axis.
    assert calibration.pixel == pytest.approx(0.16 / 900, rel=2e-3)
    # Distances anywhere on the sheet, against the lens that drew them, to 0.1 %.
    board = np.meshgrid(np.linspace(-0.01, 0.09, 6), np.linspace(-0.01, 0.06, 5))
    board = np.stack(board, axis=-1).reshape(-1, 2)
    space = np.column_stack([board + np.array([-0.04, -0.025]), np.full(len(board), 0.16)])
    seen, _ = cv2.projectPoints(space, np.zeros(3), np.zeros(3), MATRIX, BARREL)
    seen = seen[:, 0]
    here = calibration.to_m(np.column_stack([seen[:, 0], row_to_y_px(seen[:, 1], SIZE[1])]))
    apart = np.linalg.norm(here[:, None] - here, axis=-1)
    true = np.linalg.norm(board[:, None] - board, axis=-1)
    assert np.abs(apart - true).max() < 1e-3 * true.max()
    # y up: rows further down on the board are lower.
    assert here[-1, 1] < here[0, 1]
    assert here[5, 0] > here[0, 0]


def test_to_px_inverts_to_m(calibrated):
    calibration, _ = calibrated
    px = np.stack(np.meshgrid(np.linspace(0, 639, 9), np.linspace(0, 479, 7)), axis=-1)
    back = calibration.to_px(calibration.to_m(px))
    # INVERSE_PX of the module; no point is lost under this barrel
    assert np.abs(back - px).max() < 1e-3


def test_rotation_field_keeps_its_vorticity_through_the_lens(calibrated):
    """A solid-body rotation in the sheet, seen as px displacements, comes back as that rotation."""
    calibration, _ = calibrated
    rate, interval = 2.0, 2e-3
    x, y = np.arange(8.0, 632, 8), np.arange(8.0, 472, 8)
    at = np.stack(np.meshgrid(x, y), axis=-1)
    mid = calibration.to_m(at)
    centre = mid.reshape(-1, 2).mean(axis=0)
    move = rate * interval * np.stack([-(mid - centre)[..., 1], (mid - centre)[..., 0]], axis=-1)
    shift = calibration.to_px(mid + move / 2) - calibration.to_px(mid - move / 2)
    grid, small = ("y", "x"), np.full(shift.shape[:2], 0.05)
    fields = {"u": shift[..., 0], "v": shift[..., 1], "u_std": small, "v_std": small}
    fields["valid"] = np.ones(small.shape, np.uint8)
    pixels = xr.Dataset({n: (grid, f) for n, f in fields.items()}, coords={"x": x, "y": y})
    plane = calibrate_plane(pixels, calibration, interval)
    ok = plane["valid"].values == 1
    assert ok.mean() > 0.8  # the rest of the bounding box lies outside the image
    xx, yy = np.meshgrid(plane["x"], plane["y"])
    # Linear interpolation on an 8 px grid under this barrel misses by less than 0.5 % of the peak
    # speed.
    peak = rate * np.hypot(xx - centre[0], yy - centre[1])[ok].max()
    assert np.abs(plane["u"].values + rate * (yy - centre[1]))[ok].max() < 5e-3 * peak
    assert np.abs(plane["v"].values - rate * (xx - centre[0]))[ok].max() < 5e-3 * peak
    unsure = np.hypot(at[..., 0] - 320, at[..., 1] - 240) < 40
    flags = np.where(unsure, UNCERTAIN, VALID)
    doubted = pixels.assign(valid=(grid, (~unsure).astype(np.uint8)), flag=(grid, flags))
    seen = calibrate_plane(doubted, calibration, interval)
    assert (usable(seen).values == ok).all()
    assert ((seen["flag"].values == UNCERTAIN) == ok & (seen["valid"].values == 0)).all()
    assert np.abs(seen["u"] - plane["u"]).max() == 0
    # 78 vectors, and those that are interpolated from one of them
    assert 60 < (seen["flag"] == UNCERTAIN).sum() < 150
    middle = plane["u_std"].values[plane.sizes["y"] // 2, plane.sizes["x"] // 2]
    # local scale, barrel ± 5 %
    assert middle == pytest.approx(0.05 * calibration.pixel / interval, rel=0.05)


def test_rectified_board_is_square(calibrated):
    calibration, _ = calibrated
    picture = draw_board((0.0, 0.0, 0.0), (-0.04, -0.025, 0.16))
    corners, places = find_corners(rectify_image(picture, calibration), BOARD)
    assert len(corners) == 54
    fit, *_ = np.linalg.lstsq(np.column_stack([places[:, :2], np.ones(54)]), corners, rcond=None)
    miss = np.column_stack([places[:, :2], np.ones(54)]) @ fit - corners
    assert np.sqrt(np.mean(miss**2)) < 0.1  # px; before rectification it is above 0.5
    assert np.linalg.norm(fit[0]) * calibration.pixel == pytest.approx(1, rel=2e-3)


def test_file_round_trip_and_foreign_files(calibrated, tmp_path):
    calibration, _ = calibrated
    save_calibration(calibration, tmp_path / "c.json")
    again = load_calibration(tmp_path / "c.json")
    px = np.array([[3.0, 4.0], [600.0, 400.0]])
    assert np.array_equal(again.to_m(px), calibration.to_m(px))
    for text in ("", "{}", "[1]", '{"format": "piv-calibration", "format_version": 1}'):
        (tmp_path / "bad.json").write_text(text)
        with pytest.raises(ValueError, match="not a calibration file"):
            load_calibration(tmp_path / "bad.json")

    whole = json.loads((tmp_path / "c.json").read_text())
    whole["lens"]["distortion"] = [0.1, 0.0]
    (tmp_path / "bad.json").write_text(json.dumps(whole))
    with pytest.raises(ValueError, match="4, 5, 8, 12 or 14 distortion coefficients, not 2"):
        load_calibration(tmp_path / "bad.json")


@given(scale=st.floats(1e-3, 10), x=st.floats(-1e4, 1e4), y=st.floats(-1e4, 1e4))
def test_scale_and_origin(scale, x, y):
    calibration = Calibration(scale, x, y)
    assert np.abs(calibration.to_m(np.array([x, y]))).max() == 0
    px = np.array([12.5, -3.0])
    assert np.allclose(calibration.to_px(calibration.to_m(px)), px, atol=1e-8)


def test_two_points_and_bad_scales():
    assert from_points((0, 0), (300, 400), 50).scale_mm_per_px == pytest.approx(0.1)
    with pytest.raises(ValueError, match="two different points"):
        from_points((1, 1), (1, 1), 50)
    with pytest.raises(ValueError, match="positive"):
        Calibration(0.0)


def test_real_charuco_recording():
    folder = shared("pivlab_distortion")
    aligned = folder / "Board_aligned_with_sheet_and_aquarium.jpg"
    views = [cv2.imread(str(aligned), cv2.IMREAD_GRAYSCALE)]
    with open_recording(str(folder / "Boards_moving*.jpg"), colour="luma") as others:
        views += list(others)
    target = Target(8, 11, 0.008, 0.006)  # as Information.txt says
    calibration, used = calibrate_target(views, target)
    assert len(used) == 12
    # JPEG pictures of a moving hand-held board; reached: 0.36
    assert calibration.lens.reprojection_rms_px < 0.5
    # The 8 mm squares of the board in the sheet, which fixed the plane but not the lens, are 8 mm
    # everywhere.
    corners, places = find_corners(views[0], target)
    y = row_to_y_px(corners[:, 1], views[0].shape[0])
    here = calibration.to_m(np.column_stack([corners[:, 0], y]))
    apart, true = (np.linalg.norm(a[:, None] - a, axis=-1) for a in (here, places))
    side = np.isclose(true, 0.008)
    assert apart[side].mean() == pytest.approx(0.008, rel=5e-3)
    assert apart[side].std() < 1.0e-4  # a corner is found to 0.5 px of 0.13 mm
