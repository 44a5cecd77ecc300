"""reference/inputs.toml and the scenes of the runs beside the nominal one."""

import json
from operator import attrgetter

import h5py
import numpy as np
import pytest

from fileio.errors import StageError
from fileio.formats.recorded_motion import write_recorded_motion
from pipeline.scene.scene import load_scene
from pipeline.sheet import view_axes
from pipeline.stage_settings import settings_of
from postprocess.evidence.stage_files import StageFiles
from postprocess.lab.data.inputs_toml import (
    Input,
    Inputs,
    Numerics,
    read_inputs,
    write_runs,
    write_virtual,
)
from postprocess.lab.registration.profile import motion_values, strip_at_rest
from tests.conftest import motion_of
from tests.lab_scene import CASE, finger_kinematics


@pytest.fixture
def case(tmp_path):
    """A scene that extends single_finger, with what its first stages record."""
    folder = tmp_path / "cases" / "finger"
    (folder / "reference").mkdir(parents=True)
    (folder / "scene.toml").write_text(f'extends = "{CASE}"\n')
    scene = load_scene(folder, "smoke")
    scene.out.mkdir(parents=True)
    for name, stages in (
        ("kinematics.h5", ["kinematics"]),
        ("planform.h5", ["mesh"]),
        ("sweep.h5", ["case"]),
    ):
        with h5py.File(scene.out / name, "w") as file:
            file.attrs["settings"] = json.dumps(settings_of(scene, stages[0]))
    return folder


def test_each_run_changes_one_number(case):
    inputs = read_inputs(CASE / "reference" / "inputs.toml")
    nominal = load_scene(case, "smoke")
    folders = write_runs(StageFiles(case, "smoke"), inputs)
    changed = {folder.name: load_scene(folder, "smoke") for folder in folders}
    assert changed["pressure"].motion.strokes[0].pressure_kpa == pytest.approx(21.0)
    assert changed["duration"].motion.strokes[0].duration == pytest.approx(0.44)
    assert changed["time_step"].numerics.time_step == pytest.approx(nominal.numerics.time_step / 2)
    assert changed["grid"].mesh.tip_cell == pytest.approx(nominal.mesh.tip_cell / 1.5)
    assert changed["grid"].mesh.wall_layers == 3
    for name, parts in (("pressure", {"motion"}), ("grid", {"mesh"}), ("time_step", {"numerics"})):
        for part in {"motion", "mesh", "numerics", "finger", "camera"} - parts:
            assert getattr(changed[name], part) == getattr(nominal, part), (name, part)


def asked(key: str, step: float = 0.001) -> Inputs:
    """What inputs.toml would say of one number."""
    one = Input(name="one", key=key, step=step, limit=1.0, reason="r")
    return Inputs(format="inputs", format_version=1, too_uncertain=0.3, input=(one,))


@pytest.mark.parametrize("key, step", [("finger.tip.length", 0.001), ("mesh.tip_cell", 0.0001)])
def test_a_number_beside_one_that_is_not_given_or_of_a_level_is_changed_too(case, key, step):
    """finger.tip.thickness has no value in TOML; mesh.tip_cell is given by the level."""
    nominal = load_scene(case, "smoke")
    [folder] = write_runs(StageFiles(case, "smoke"), asked(key, step))
    run = load_scene(folder, "smoke")
    where, name = key.rsplit(".", 1)
    value, before = (getattr(attrgetter(where)(scene), name) for scene in (run, nominal))
    assert value == pytest.approx(before + step)


@pytest.mark.parametrize(
    "key", ["nothing.at.all", "motion", "motion.strokes.first", "motion.source", "motion.states"]
)
def test_what_is_no_number_of_the_scene_is_said(case, key):
    with pytest.raises(ValueError, match="the scene has no number"):
        write_runs(StageFiles(case, "smoke"), asked(key))


def test_scenes_that_did_not_change_are_left_alone(case):
    inputs = read_inputs(CASE / "reference" / "inputs.toml")
    first = [folder / "scene.toml" for folder in write_runs(StageFiles(case, "smoke"), inputs)]
    before = [path.stat().st_mtime_ns for path in first]
    write_runs(StageFiles(case, "smoke"), inputs)
    assert [path.stat().st_mtime_ns for path in first] == before


def test_virtual_laboratory_has_its_own_pressure(case):
    folder = write_virtual(StageFiles(case, "smoke"), 21.0)
    assert load_scene(folder, "smoke").motion.strokes[-1].pressure_kpa == 21.0


def test_standard_uncertainties():
    inputs = read_inputs(CASE / "reference" / "inputs.toml")
    pressure = inputs.input[0]
    assert pressure.std == pytest.approx(0.2 / np.sqrt(3))
    grid = next(n for n in inputs.numerics if n.name == "grid")
    assert grid.per_difference == pytest.approx(0.5 * 3 / (1.5**2 - 1))


@pytest.mark.parametrize("order, ratio", [(2.0, 1.5), (1.0, 2.0)])
def test_numerical_band_is_that_of_the_finer_run(order, ratio):
    """f(h) = 1 + h^p at the order assumed: with a safety factor of 1 the 95 % band is the finer run's own error."""
    nominal, finer = 1 + 0.1**order, 1 + (0.1 / ratio) ** order
    one = Numerics(name="grid", ratio=ratio, order=order, safety=1.0)
    assert 2 * one.per_difference * (nominal - finer) == pytest.approx((0.1 / ratio) ** order)


SOUND = 'format = "inputs"\nformat_version = 1\ntoo_uncertain = 0.3\n'


@pytest.mark.parametrize(
    "text, told",
    [("nonsense", "not valid TOML"), ("nonsense =", "no value is given for nonsense;"), ('format = "x"\nformat_version = 1\ntoo_uncertain = 0.3', 'format = "inputs"'),
     ('format = "inputs"\nformat_version = 1', "too_uncertain"),
     (SOUND + "[[input]]\nname = 'a'\nkey = 'b.c'\nstep = 0\nlimit = 1\nreason = 'r'", "another step"),
     (SOUND + "[[numerics]]\nname = 'wall'\nratio = 2\norder = 2\nsafety = 3", "'grid' or 'time_step'")],
)  # fmt: skip
def test_bad_files_are_one_sentence(tmp_path, text, told):
    path = tmp_path / "inputs.toml"
    path.write_text(text)
    with pytest.raises(ValueError, match=told):
        read_inputs(path)


def test_recorded_motion_drives_the_kinematics(tmp_path):
    kinematics = finger_kinematics(tmp_path)
    times = np.linspace(0.0, 0.42, 60)
    bend = 1.05 * kinematics.bend(kinematics.law(times))
    motion = motion_values(
        kinematics,
        strip_at_rest(kinematics),
        times,
        np.column_stack([bend, 0 * bend, 0 * bend, 0 * bend]),
        0.42,
    )
    about = {"recording": "r", "dpiv_sha256": "0", "registration": "{}"}
    write_recorded_motion(tmp_path / "motion.h5", motion | about)
    folder = tmp_path / "measured"
    folder.mkdir()
    lines = [
        f'extends = "{CASE}"',
        "[motion]",
        'source = "recording"',
        'recording = "../motion.h5"',
        "strokes = []",
    ]
    (folder / "scene.toml").write_text("\n".join(lines) + "\n")
    driven = motion_of(load_scene(folder, "smoke"))
    at = np.linspace(0.05, 0.4, 30)
    moved = np.array([driven.shapes.bend(p) for p in driven.law(at)])
    assert np.abs(np.degrees(moved - np.interp(at, times, bend))).max() < 0.5
    assert (
        np.abs(driven.law(at, 1)).max() < 1.2 * 1.05 * np.abs(kinematics.law(at, 1)).max()
    )  # no ripple from the spline


def test_recording_and_strokes_exclude_each_other(tmp_path):
    (tmp_path / "scene.toml").write_text(
        f'extends = "{CASE}"\n[motion]\nsource = "recording"\nrecording = "m.h5"\n'
    )
    with pytest.raises(StageError, match=r"no strokes \(strokes = \[\]\)"):
        load_scene(tmp_path, "smoke")


def test_view_of_a_laboratory_camera_stays_in_the_water():
    scene = load_scene(CASE, "smoke")
    x, y = view_axes((-0.08, 0.12, 0.10, 0.40), scene)
    spacing = scene.sheet.spacing
    assert x[0] == pytest.approx(-0.08, abs=spacing)
    assert y[-1] == pytest.approx(scene.tank.water_depth, abs=spacing)
    assert np.allclose(np.diff(x), spacing)
    with pytest.raises(StageError, match="shows no water"):
        view_axes((0.5, 0.6, 0.1, 0.2), scene)


def test_command_asks_for_the_sheet(tmp_path, capsys):
    from postprocess.lab.__main__ import main

    assert main(["register", str(tmp_path), "--dpiv", str(tmp_path)]) == 2
    assert "dpiv.toml: missing" in capsys.readouterr().err
