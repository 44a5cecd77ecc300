"""What a stage has written is read whole or not at all: each format, damaged in twelve ways."""

import json
import os
import shutil

import numpy as np
import pandas as pd
import pytest

from fileio.atomic import checksum_file, checksums_of, write_bytes, write_text
from fileio.checksum import check_whole
from fileio.errors import sentence
from fileio.formats.kinematics import read_kinematics
from fileio.formats.mesh_intervals import read_intervals, read_planforms
from fileio.formats.plane_series import make_plane, read_plane, write_plane
from fileio.formats.recording import RecordingWriter, open_recording_file
from fileio.formats.records import FORCES, RUN
from fileio.formats.sweep import read_sweep
from fileio.formats.vortex_table import COLUMNS, read_vortices, write_vortices
from fileio.json_text import read_json
from tests.conftest import prepare, write_scene
from tests.damage import WAYS, damage


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """A file of each format that stages hand on, with its checksum."""
    folder = tmp_path_factory.mktemp("written")
    scene = prepare(write_scene(folder / "scene"))
    with checksums_of([folder]):
        for name in ("kinematics.h5", "planform.h5", "sweep.h5"):
            write_bytes(folder / name, (scene.out / name).read_bytes())
        x, y, t = np.arange(8.0), np.arange(6.0), np.arange(3.0)
        u = np.random.default_rng(0).normal(size=(3, 6, 8))
        write_plane(make_plane(x, y, u, u, time=t), folder / "sheet.h5", source="cfd")
        with RecordingWriter(
            folder / "images.h5", (24, 32), np.uint8, 3, {"frame_rate_hz": 100.0}
        ) as writer:
            for k in range(3):
                writer.write(k, np.full((24, 32), k, np.uint8))
            writer.finish()
        FORCES.write(
            folder / "forces.csv", np.random.default_rng(1).normal(size=(20, len(FORCES.columns)))
        )
        table = pd.DataFrame(
            np.random.default_rng(2).normal(size=(9, len(COLUMNS))), columns=COLUMNS
        )
        write_vortices(table, folder / "vortices.csv")
        RUN.write(folder / "run.json", {"wall_time": 1.5, "steps": 3})
        write_text(folder / "settings.json", json.dumps({"window": 32, "epsilon": 0.2}))
    return folder


READERS = {
    "kinematics.h5": read_kinematics,
    "planform.h5": lambda path: read_intervals(path.parent),
    "sweep.h5": lambda path: read_sweep(path.parent, "interval_0"),
    "sheet.h5": read_plane,
    "images.h5": open_recording_file,
    "forces.csv": FORCES.read,
    "vortices.csv": read_vortices,
    "run.json": RUN.read,
    "settings.json": lambda path: read_json(path, "make it again"),
}


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("name", READERS)
def test_what_is_damaged_is_refused_in_one_sentence(written, tmp_path, name, way):
    shutil.copy(written / name, tmp_path / name)
    shutil.copy(checksum_file(written / name), tmp_path)
    READERS[name](tmp_path / name)
    damage(tmp_path / name, way)
    with pytest.raises((ValueError, OSError)) as caught:
        READERS[name](tmp_path / name)
    told = sentence(caught.value)
    assert told
    assert "\n" not in told
    assert str(tmp_path / name) in told
    assert "delete it and run make again" in told


@pytest.mark.parametrize(
    "way",
    ["empty", "cut in half", "noise", "another format", "version 99", "a part taken out", "NaN"],
)
@pytest.mark.parametrize("name", ["kinematics.h5", "planform.h5"])
def test_the_schema_refuses_most_without_a_checksum_too(written, tmp_path, name, way):
    """As of files that were made before there were any."""
    readers = {"kinematics.h5": read_kinematics, "planform.h5": read_planforms}
    shutil.copy(written / name, tmp_path / name)
    damage(tmp_path / name, way)
    with pytest.raises((ValueError, OSError)) as caught:
        readers[name](tmp_path / name)
    assert "\n" not in str(caught.value)


def test_a_file_that_is_written_anew_loses_the_checksum_of_the_old_one(written, tmp_path):
    shutil.copy(written / "run.json", tmp_path)
    shutil.copy(checksum_file(written / "run.json"), tmp_path)
    RUN.write(tmp_path / "run.json", {"wall_time": 2.0})
    assert RUN.read(tmp_path / "run.json")["wall_time"] == 2.0
    with RecordingWriter(
        tmp_path / "images.h5", (4, 4), np.uint8, 1, {"frame_rate_hz": 1.0}
    ) as writer:
        checksum_file(tmp_path / "images.h5").write_text("0  images.h5\n")
        writer.write(0, np.zeros((4, 4), np.uint8))
        writer.finish()
    check_whole(tmp_path / "images.h5")


def test_a_kill_between_a_file_and_its_checksum_leaves_nothing_unchecked(tmp_path, monkeypatch):
    """The checksum comes first: there is no file yet, or the old one, which is refused."""
    path = tmp_path / "forces.csv"
    whole_replace = os.replace

    def killed(part, name):
        if name == path:
            raise KeyboardInterrupt
        whole_replace(part, name)

    with checksums_of([path]):
        monkeypatch.setattr(os, "replace", killed)
        with pytest.raises(KeyboardInterrupt):
            write_text(path, "new")
        assert checksum_file(path).exists()
        monkeypatch.undo()
        write_text(path, "old")
        check_whole(path)
        monkeypatch.setattr(os, "replace", killed)
        with pytest.raises(KeyboardInterrupt):
            write_text(path, "new")
        with pytest.raises(ValueError, match="delete it and run make again"):
            check_whole(path)


@pytest.mark.parametrize("content", [b"null", b"[1]", b"[" * 100_000, b'{"format": "run"}', b""])
def test_a_record_that_is_none_is_one_sentence_without_a_checksum_too(tmp_path, content):
    (tmp_path / "run.json").write_bytes(content)
    with pytest.raises(ValueError, match="delete it and run make again") as caught:
        RUN.read(tmp_path / "run.json")
    assert "\n" not in str(caught.value)
