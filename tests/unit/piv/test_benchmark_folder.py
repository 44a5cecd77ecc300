"""The folder of `make benchmark`, with the recording that needs no flow."""

import hashlib
import json
import shutil

import pytest

from docs.evidence import benchmark
from piv.__main__ import main
from piv.images.open_recording import open_recording
from postprocess.lab.dpiv_toml import read_dpiv


def test_the_folder_is_whole_and_its_truth_scores_itself(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(benchmark, "SCENES", {})
    monkeypatch.setattr(benchmark, "FRAMES", 2)
    folder = tmp_path / "benchmark"
    benchmark.main(folder)
    for line in (folder / "SHA256SUMS").read_text().splitlines():
        digest, name = line.split("  ")
        assert hashlib.sha256((folder / name).read_bytes()).hexdigest() == digest
    assert json.loads((folder / "datacite.json").read_text())["rightsList"]
    recording = folder / "turbulence"
    with open_recording(read_dpiv(recording).sources()) as pictures:
        assert len(pictures) == 2
    capsys.readouterr()
    truth = str(recording / "truth.nc")
    vectors = shutil.copy(truth, tmp_path / "vectors.h5")
    assert main(["score", str(vectors), "--truth", truth]) == 0
    table = dict(line.rsplit(maxsplit=1) for line in capsys.readouterr().out.splitlines())
    measures = {name.strip(): float(value) for name, value in table.items()}
    # vectors at the truth's own points; the spline gives them back to single precision
    assert measures["RMS error, px"] < 1e-5
    assert measures["vortices found, %"] == 100


def test_a_folder_of_something_else_is_not_taken(tmp_path):
    (tmp_path / "thesis.txt").write_text("all of it")
    (tmp_path / "README.md").write_text("# My thesis")
    (tmp_path / "SHA256SUMS").write_text("")  # of somebody else's files
    with pytest.raises(SystemExit, match="no benchmark"):
        benchmark.main(tmp_path)
    assert (tmp_path / "thesis.txt").exists()
