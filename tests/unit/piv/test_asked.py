"""Every command of the guide's table of what users of other programs ask for runs."""

import re
import shutil

import cv2
import numpy as np

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


def test_each_row_runs(tmp_path, monkeypatch):
    inputs(tmp_path)
    monkeypatch.chdir(tmp_path)
    guide = (ROOT / "docs" / "piv_asked.md").read_text(encoding="utf-8")
    commands = [c for c in ROW.findall(guide) if not c.startswith("view")]
    assert len(commands) > 15
    for command in commands:
        words = command.split()
        assert piv(*words) == 0, command
        assert (tmp_path / words[words.index("-o") + 1]).exists()
