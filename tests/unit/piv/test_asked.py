"""Every command of the guide's table of what users of other programs ask for runs."""

import re
import shutil

import cv2
import numpy as np

from piv import read_plane, usable
from tests import pivlab_session
from tests.conftest import ROOT
from tests.piv_command import piv

ROW = re.compile(r"^\|.*\| `piv (.*)` \|$", re.MULTILINE)


def inputs(folder):
    """What the commands name: a film, pairs, images of 16 bit, a board, vectors of OpenPIV."""
    frames = ROOT / "docs" / "tutorials" / "frames"
    shutil.copytree(frames, folder / "run1")
    (folder / "pairs").mkdir()
    for k in range(4):
        image = cv2.imread(str(frames / f"frame_{k}.png"), cv2.IMREAD_UNCHANGED)
        cv2.imwrite(str(folder / f"pairs/im_{k // 2}_{'AB'[k % 2]}.png"), image)
        if k < 2:
            cv2.imwrite(str(folder / f"deep_{'ab'[k]}.tif"), image.astype(np.uint16) * 16)
    squares = np.indices((7, 9)).sum(axis=0) % 2 * 255
    board = np.pad(np.kron(squares, np.ones((20, 20))), 22, constant_values=255)
    cv2.imwrite(str(folder / "board.png"), board.astype(np.uint8))
    x, y = np.meshgrid(np.arange(8.0, 200, 16), np.arange(8.0, 180, 16))
    rows = np.column_stack([a.ravel() for a in (x, y, 0 * x + 1, 0 * x + 2, 0 * x, 0 * x)])
    np.savetxt(folder / "field.txt", rows, header="x y u v flags mask")
    film = cv2.VideoWriter(
        str(folder / "film.avi"), cv2.VideoWriter_fourcc(*"FFV1"), 25, (224, 192)
    )
    for k in range(6):
        image = cv2.imread(str(frames / f"frame_{k}.png"))
        film.write(image)
        if k < 2:
            green = image * np.array([0.3, 1, 0.2])
            cv2.imwrite(str(folder / f"m{k + 1}.jpg"), green.astype(np.uint8))
            narrow = np.vstack([image[:, 80:128, 0]] * 3)
            cv2.imwrite(str(folder / f"narrow_{'ab'[k]}.tif"), narrow)
    film.release()
    more = {"calxy": 1e-4, "calu": 0.05, "expected_image_size": np.array([32.0, 48.0])}
    pivlab_session.write_session(folder / "session.mat", **more)
    (folder / "body.csv").write_text("0,0\n60,0\n60,191\n0,191\n")
    head = '#DaVis 8.1.6 2D-vector 16 2 2 "position" "mm" "position" "mm" "velocity" "m/s"\n'
    (folder / "B00001.txt").write_text(head + "0\t1\t0\t-0\n1\t1\t1,5\t2\n0\t0\t1\t2\n1\t0\t1\t2\n")


def test_each_row_runs(tmp_path, monkeypatch):
    inputs(tmp_path)
    monkeypatch.chdir(tmp_path)
    guide = (ROOT / "docs" / "piv_asked.md").read_text(encoding="utf-8")
    commands = [c for c in ROW.findall(guide) if not c.startswith("view")]
    assert len(commands) >= 30
    for command in commands:
        words = command.split()
        assert piv(*words) == 0, command
        assert (tmp_path / words[words.index("-o") + 1]).exists()
    good = {name: piv_of(tmp_path / f"{name}.h5") for name in LOOKED_AT}
    assert all(usable(good[name]).mean() > 0.9 for name in ("colour", "narrow", "film", "five"))
    for name in ("replaced", "polygon"):
        body = good[name]["flag"] == 2
        assert body.any()
        assert not good[name]["valid"].where(body, 0).any()
    np.testing.assert_allclose(good["session"]["u"][:, 1, 0], [0.04, 0.08])
    assert good["davis"]["valid"].values.tolist() == [[1, 1], [0, 1]]
    # the film was thinned to every other pair, two frames apart
    np.testing.assert_allclose(good["film"]["time"], [1, 3])


LOOKED_AT = ("colour", "narrow", "session", "film", "five", "replaced", "polygon", "davis")


def piv_of(path):
    """The vectors of a file, in memory."""
    with read_plane(path) as plane:
        return plane.load()
