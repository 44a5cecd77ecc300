"""Generated case files, compared as parsed trees with those that were checked by hand."""

import json
import re
from dataclasses import replace
from pathlib import Path

import pytest
from foamlib import FoamFile

from pipeline.case.interval_case import numbers, numbers_text, regions_text
from pipeline.formats.mesh_intervals import Interval
from pipeline.openfoam.foamfile import set_number
from pipeline.scene.scene import load_scene
from piv.files.errors import StageError
from tests.conftest import CASES, write_scene

HERE = Path(__file__).parent
WHOLE = Interval(0, 0.0, 0.0, 0.42, 0)
SECOND = Interval(1, 0.158, 0.166, 0.64, 1)


def tree(path: Path) -> object:
    """A dictionary file as plain Python values."""

    def plain(value):
        if isinstance(value, dict):
            return {k: plain(v) for k, v in value.items()}
        if isinstance(value, list | tuple):
            return [plain(v) for v in value]
        return value if isinstance(value, int | float | str | bool) else str(value)

    return plain(dict(FoamFile(path).as_dict()))


@pytest.mark.parametrize(
    "scene, level, interval",
    [
        ("single_finger", "smoke", WHOLE),
        ("single_finger", "coarse", WHOLE),
        ("single_deflate", "coarse", WHOLE),
        ("pinch", "smoke", SECOND),
        ("pinch", "coarse", replace(SECOND, begin=0.162)),
        ("cycle", "coarse", Interval(0, 0.0, 0.0, 1.2, 0)),
    ],
)
def test_numbers_are_the_checked_ones(tmp_path, scene, level, interval):
    loaded = load_scene(CASES / scene, level)
    back = -loaded.finger.width if loaded.model.kind == "2d" else -loaded.tank.size[2] / 2
    (tmp_path / "numbers").write_text(numbers_text(numbers(loaded, interval, interval.end, back)))
    golden = HERE / f"numbers_{scene}_{level}.json"
    assert tree(tmp_path / "numbers") == json.loads(golden.read_text())


@pytest.mark.parametrize("kind", ["half", "full"])
def test_regions_are_the_checked_ones(tmp_path, kind):
    (tmp_path / "regions").write_text(regions_text(kind))
    assert tree(tmp_path / "regions") == json.loads((HERE / f"regions_{kind}.json").read_text())


def test_the_base_case_uses_every_number_and_no_other(tmp_path):
    """A number that no file of the base case names would be an option that does nothing."""
    base = CASES / "_base"
    text = "\n".join(path.read_text() for path in base.rglob("*") if path.is_file())
    entries = numbers(write_scene(tmp_path / "s"), WHOLE, WHOLE.end, -0.028)
    assert set(re.findall(r"\$(\w+)", text)) - {"p"} == set(entries)
    assert set(tree(base / "system" / "numbers")) == set(entries)
    with pytest.raises(StageError, match="occurs 0 times"):
        set_number(base, "noSuchNumber", "1")


def test_scene_keys_reach_the_numbers(tmp_path):
    more = '[fluid]\ndensity = 1025.0\nkinematic_viscosity = 2e-6\nturbulence = "WALE"'
    numerics = ', time_scheme = "Euler", outer_correctors = 3'
    scene = write_scene(tmp_path / "s", "half", more, numerics)
    entries = numbers(scene, WHOLE, WHOLE.end, -0.15)
    assert entries.items() >= {
        "density": "1025", "viscosity": "2e-06", "simulationType": "LES", "timeScheme": "Euler",
        "outerCorrectors": "3", "sheetType": "symmetryPlane",
    }.items()  # fmt: skip
    motion = scene.motion.model_copy(update={"source": "structure"})
    coupled = scene.model_copy(update={"motion": motion})
    every_step = numbers(coupled, WHOLE, WHOLE.end, -0.15)
    assert {k for k in entries if every_step[k] != entries[k]} == {"wallInterval"}
    assert every_step["wallInterval"] == "1"
    second = numbers(scene, Interval(1, 0.192, 0.2, 0.35, 1), 0.35, -0.15)
    # it starts 8 time steps of 1 ms before it takes over
    times = {"startTime": "0.192", "endTime": "0.35", "handoverStep": "350"}
    assert {k: second[k] for k in second if second[k] != entries[k]} == times
    rest = numbers(scene, Interval(1, 0.192, 0.2, 0.35, 1, moving=False), 0.35, -0.15)
    assert {k: rest[k] for k in rest if rest[k] != second[k]} == {"meshMotion": "staticFvMesh"}
