"""reference/inputs.toml and the rows of the runs beside the nominal one."""

import pytest

from pipeline.__main__ import main
from pipeline.scene.scene import load_scene
from postprocess.evidence.stage_files import StageFiles, scene_numbers
from postprocess.lab.data.inputs_toml import (
    Input,
    Inputs,
    Numerics,
    input_rows,
    read_inputs,
)
from tests.lab_scene import CASE


@pytest.fixture
def case(tmp_path):
    """A scene that extends single_finger, and its numbers."""
    folder = tmp_path / "cases" / "finger"
    folder.mkdir(parents=True)
    (folder / "scene.toml").write_text(f'extends = "{CASE}"\n')
    return folder, scene_numbers(StageFiles(load_scene(folder, "smoke")))


def runs(case, inputs):
    """Scenes of the runs beside the nominal one, by name."""
    rows = input_rows(case[1], inputs)
    return {name: load_scene(case[0], "smoke", o, case[0] / name) for name, o in rows}


def test_each_run_changes_one_number(case):
    nominal, changed = load_scene(case[0], "smoke"), runs(case, read_inputs(CASE))
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
def test_a_number_of_a_table_or_of_a_level_is_changed(case, key, step):
    """finger.tip.thickness has no value in TOML; mesh.tip_cell is set by the level."""
    value = case[1]
    for name in key.split("."):
        value = value[name]
    assert input_rows(case[1], asked(key, step)) == [("one", {key: value + step})]
    run = runs(case, asked(key, step))["one"]
    for name in key.split("."):
        run = getattr(run, name)
    assert run == pytest.approx(value + step)


@pytest.mark.parametrize(
    "key", ["nothing.at.all", "motion", "motion.strokes.first", "motion.source", "motion.states"]
)
def test_a_key_that_is_no_number_of_the_scene_is_refused(case, key):
    with pytest.raises(ValueError, match="the scene has no number"):
        input_rows(case[1], asked(key))


@pytest.mark.parametrize("order, ratio", [(2.0, 1.5), (1.0, 2.0)])
def test_numerical_band_is_that_of_the_finer_run(order, ratio):
    """f(h) = 1 + h^p: with a safety factor of 1 the 95 % band is the finer run's own error."""
    nominal, finer = 1 + 0.1**order, 1 + (0.1 / ratio) ** order
    one = Numerics(name="grid", ratio=ratio, order=order, safety=1.0)
    assert 2 * one.per_change * (nominal - finer) == pytest.approx((0.1 / ratio) ** order)


SOUND = 'format = "inputs"\nformat_version = 1\ntoo_uncertain = 0.3\n'
INPUT = "[[input]]\nname = 'a'\nkey = 'b.c'\nstep = 0\nlimit = 1\nreason = 'r'"
NUMERICS = "[[numerics]]\nname = 'wall'\nratio = 2\norder = 2\nsafety = 3"


@pytest.mark.parametrize(
    "text, message",
    [
        ("nonsense", "not valid TOML"),
        ("nonsense =", "no value is given for nonsense;"),
        (SOUND.replace('"inputs"', '"x"'), 'format = "inputs"'),
        (SOUND.replace("too_uncertain = 0.3", ""), "too_uncertain"),
        (SOUND + INPUT, "another step"),
        (SOUND + NUMERICS, "'grid' or 'time_step'"),
    ],
)
def test_bad_files_are_one_sentence(tmp_path, text, message):
    (tmp_path / "reference").mkdir()
    (tmp_path / "reference" / "inputs.toml").write_text(text)
    with pytest.raises(ValueError, match=message):
        read_inputs(tmp_path)


def test_command_asks_for_dpiv_toml(tmp_path, capsys):
    assert main(["compare", str(CASE), str(tmp_path), "--level", "smoke"]) == 2
    assert "holds no dpiv.toml" in capsys.readouterr().err
    (tmp_path / "dpiv.toml").write_text('format = "dpiv"\nformat_version = 4\n')
    assert main(["compare", str(CASE), str(tmp_path), "--level", "smoke"]) == 2
    assert "title is missing" in capsys.readouterr().err
