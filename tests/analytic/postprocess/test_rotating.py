"""Secondary vortices behind a rotating plate, counted in a flow that is made of known vortices."""

import shutil

import numpy as np
import pytest

from pipeline.kinematics.rigid_body import travelled
from pipeline.scene.scene import load_scene
from piv.files.errors import StageError
from piv.formats.plane_series import make_plane, write_plane
from tests.studies.validation import rotating
from tests.studies.validation.solve import CASES

L, CENTRE, SPEED = 0.04, np.array([0.0, 0.4]), np.radians(400.0)
UNIT = SPEED * L**2
RELEASED = (36.0, 48.0, 60.0)  # turn at which a small vortex begins to stay behind the tip


def _out(turn):
    return np.array([np.cos(np.radians(turn)), np.sin(np.radians(turn))])


def _lamb(x, y, at, part, core):
    """Velocity of a clockwise Lamb-Oseen vortex of `part` of Ω L²."""
    dx, dy = x - at[0], y - at[1]
    square = dx**2 + dy**2 + 1e-15
    swirl = -part * UNIT / (2 * np.pi * square) * -np.expm1(-square / core**2)
    return -swirl * dy, swirl * dx


def _flow(x, y, turn, small):
    """The vortex 0.4 to 0.9 L behind the tip, and small ones just beyond where the tip was."""
    tip, back = CENTRE + L * _out(turn), _out(turn - 90.0)
    u, v = _lamb(x, y, tip + min(0.9, turn / 75) * L * back, 0.8, 0.12 * L)
    for released in RELEASED[:small]:
        if turn > released:
            more = _lamb(x, y, CENTRE + 1.1 * L * _out(released), 0.03, 0.03 * L)
            u, v = u + more[0], v + more[1]
    return u, v


@pytest.mark.parametrize("small", [0, 3])
def test_vortices_behind_a_rotating_plate(tmp_path, small):
    shutil.copy(CASES / rotating.STUDY / "scene.toml", tmp_path)
    scene = load_scene(tmp_path, "c40")
    path = travelled(scene.motion.rotation, scene.motion.end_time)
    turns = np.arange(30.0, 80.0, 2.0)
    axis = np.arange(-0.09, 0.0901, 5e-4)
    x, y = np.meshgrid(axis, axis + CENTRE[1])
    u, v = np.array([_flow(x, y, turn, small) for turn in turns]).swapaxes(0, 1)
    wall = [[CENTRE + s * L * _out(t) + w for s, w in ((1, 0), (-1, 0), (-1, 1e-3))] for t in turns]
    time = np.interp(turns, path.distance, path.time)
    scene.out.mkdir(parents=True)
    plane = make_plane(axis, axis + CENTRE[1], u, v, time=time, outline=np.array(wall)[:, None])
    write_plane(plane, scene.out / "sheet.h5")
    layer = rotating.layer_of("known", scene)
    # a vortex is seen once it is off the plate, 3 L / 80: up to three pictures late
    assert layer.released == pytest.approx(RELEASED[:small], abs=6.0)
    # within 3 L / 10 of a core that is smoothed over L / 10
    within = -np.expm1(-0.09 / (0.12**2 + 2 * rotating.WHOLE**2))
    assert layer.circulation[2] == pytest.approx(0.8 * within, rel=0.03)
    assert layer.place[2] == pytest.approx((0.0, turns[2] / 75), abs=0.02)


def test_a_stale_run_is_named_and_not_left_out(monkeypatch):
    def stale(row, study):
        raise StageError(f"{row} of {study}: run make validate")

    monkeypatch.setattr(rotating, "solved", stale)
    with pytest.raises(StageError, match="re840_c40"):
        rotating.measure()
