"""COUPLED=1 with a solver that is a formula: the order of its runs, what is kept, and what is refused."""

import shutil
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest

from fileio.errors import StageError
from fileio.formats.elastic_motion import read_elastic_motion
from fileio.formats.finger_loads import read_loads, write_loads
from pipeline.kinematics.stage import kinematics_values
from pipeline.scene.scene import load_scene
from pipeline.structure.coupling import loads_of_model
from pipeline.study import couple

CASE = Path(__file__).parents[3] / "cases" / "single_finger"
SHORT = "end_time = 0.12\nstrokes = [{ pressure_kpa = 20.0, start = 0.005, duration = 0.2 }]\n"


@pytest.fixture
def scene_of(tmp_path):
    def write(more="", level="smoke"):
        (tmp_path / "scene.toml").write_text(f'extends = "{CASE}"\n[motion]\n{SHORT}{more}')
        return load_scene(tmp_path, level)

    return write


@pytest.fixture
def made(monkeypatch):
    """Targets in order; `loads` of a water between the first guess and the iteration's model."""
    targets = []

    def make(home, name, level, target, ranks, quiet):
        targets.append((name, level, target))
        if target != "loads":
            return
        scene = load_scene(home / name, level)
        assert scene.motion.source == "structure"
        structure = couple.Structure(
            scene.model_copy(update={"motion": scene.motion.model_copy(update={"source": "fea"})})
        )
        delta = read_elastic_motion(home / name / "elastic_motion.h5")["delta"].values
        truth = replace(structure.around, added_mass=1.0, drag=3.0)
        values = loads_of_model(structure.chain, structure.pressure, delta, structure.step, truth)[
            1:
        ]
        values = np.concatenate(
            [np.zeros((len(values), 1, 3)), values], axis=1
        )  # the clamped length
        scene.out.mkdir(parents=True, exist_ok=True)
        write_loads(
            scene.out,
            {
                "time": structure.time[1:],
                "force": values[..., :2],
                "torque": values[..., 2],
                "unknown": "coupled",
            },
            {},
        )

    monkeypatch.setattr(couple, "make_run", make)
    return targets


def test_runs_at_the_cheap_level_first_then_at_the_scenes(scene_of, made):
    folder = couple.couple(scene_of(level="coarse"), ranks=1, quiet=True)
    levels = [level for _, level, target in made if target == "loads"]
    assert levels == sorted(levels, reverse=True)  # draft before coarse
    assert set(levels) == {"draft", "coarse"}
    assert 2 <= len(levels) <= 5
    assert made[-1] == (folder.name, "coarse", "report")


def test_two_first_motions_end_within_the_tolerance(scene_of, made):
    """40° apart at first: the prescribed motion, and that under the modelled water."""
    firsts, lasts = [], []
    for first in ("modelled water", "prescribed"):
        scene = scene_of(f'[structure]\nfirst_motion = "{first}"\n')
        folder = couple.couple(scene, ranks=1, quiet=True)
        at = folder.parent / "smoke_1" / "elastic_motion.h5"
        firsts.append(read_elastic_motion(at))
        lasts.append(read_elastic_motion(folder / "elastic_motion.h5"))
    apart, left = (
        np.hypot(*(one[name] - other[name] for name in ("profile_x", "profile_y"))).max()
        for one, other in (firsts, lasts)
    )
    assert apart > 0.02  # m
    assert left < scene.structure.tolerance * scene.finger.length


def test_a_motion_with_open_energy_is_run_again(scene_of, made, monkeypatch):
    """A limit on the energy that the change of the tip alone does not meet."""
    couple.couple(scene_of(), ranks=1, quiet=True)
    usual = len(made)
    made.clear()
    monkeypatch.setattr(couple, "OPEN", 0.2)
    couple.couple(scene_of(), ranks=1, quiet=True)
    assert len(made) > usual


def test_a_second_start_keeps_the_motions_that_are_there(scene_of, made):
    scene = scene_of()
    folder = couple.couple(scene, ranks=1, quiet=True)
    motions = sorted(folder.parent.glob("*/elastic_motion.h5"))
    before = [path.stat().st_mtime_ns for path in motions]
    runs = list(made)
    assert couple.couple(scene, ranks=1, quiet=True) == folder
    assert [path.stat().st_mtime_ns for path in motions] == before
    assert made == [*runs, *runs]  # make finds them done
    couple.couple(scene_of("start_pressure_kpa = 1.0\n"), ranks=1, quiet=True)
    assert [path.stat().st_mtime_ns for path in motions] != before


def test_the_last_run_leaves_what_its_own_loads_would_change(scene_of, made):
    scene = scene_of()
    folder = couple.couple(scene, ranks=1, quiet=True)
    own, after = (read_elastic_motion(folder / name) for name in ("elastic_motion.h5", "after.h5"))
    loads = read_loads(folder / "out" / "smoke" / "loads.h5")
    np.testing.assert_allclose(
        after["delta"], couple.Structure(scene).next(own["delta"].values, loads)
    )
    assert (
        after.attrs["tip_change"]
        <= scene.structure.tolerance * scene.finger.length
        < own.attrs["tip_change"]
    )
    assert not (folder.parent / "smoke_1" / "after.h5").exists()


def test_too_few_runs_end_with_a_sentence(scene_of, made):
    with pytest.raises(StageError, match=r"after 1 runs .* raise structure\.iterations"):
        couple.couple(scene_of("[structure]\niterations = 1\n"), ranks=1, quiet=True)
    assert len(made) == 1


def test_too_few_runs_for_the_fine_level_end_with_a_sentence(scene_of, made):
    """The first run is near enough at draft, and none is left for coarse."""
    with pytest.raises(
        StageError,
        match=r"after 1 runs the motion of level coarse is not reached: .* energy was open",
    ):
        couple.couple(scene_of("[structure]\niterations = 1\n", "coarse"), ranks=1, quiet=True)
    assert [level for _, level, _ in made] == ["draft"]


def test_new_bending_states_make_new_motions(scene_of, made, tmp_path):
    """The same numbers in scene.toml, another content of the file that they name."""
    states = tmp_path / "states.h5"
    shutil.copy(CASE / "kinematics" / "states.h5", states)
    scene = scene_of('states = "states.h5"\n')
    folder = couple.couple(scene, ranks=1, quiet=True)
    first = folder.parent / "smoke_1" / "elastic_motion.h5"
    before = read_elastic_motion(first)["delta"].values
    with h5py.File(states, "r+") as file:
        file["bending_stiffness"][...] *= 2
    couple.couple(scene, ranks=1, quiet=True)
    after = read_elastic_motion(first)["delta"].values
    assert np.abs(after).max() < np.abs(before).max()  # a stiffer finger gives way less


def test_a_title_with_quotation_marks_is_kept(scene_of, made, tmp_path):
    scene = scene_of()
    path = tmp_path / "scene.toml"
    path.write_text("title = 'A \"soft\" finger'\n" + path.read_text())
    folder = couple.couple(load_scene(tmp_path, scene.level), ranks=1, quiet=True)
    assert load_scene(folder, "smoke").title == 'A "soft" finger, coupled'


def pinch_of(folder, end_time):
    (folder / "scene.toml").write_text(
        f'extends = "{CASE.parent / "pinch"}"\n[motion]\nend_time = {end_time}\n'
    )
    return load_scene(folder, "smoke")


def test_a_pinch_is_coupled_up_to_its_contact_which_holds_it(tmp_path, made):
    """The motion goes on without a jump from where the tips are slowed down, and ends at the residual gap."""
    scene = pinch_of(tmp_path, 0.3)
    folder = couple.couple(scene, ranks=1, quiet=True)
    assert folder.name == "contact_smoke"
    assert [target for *_, target in made[:-1]].count("report") == 0
    assert made[-1] == ("contact_smoke", "smoke", "report")
    last = read_elastic_motion(tmp_path / "out" / "coupled" / made[-2][0] / "elastic_motion.h5")
    whole = read_elastic_motion(folder / "elastic_motion.h5")
    count = last.sizes["time"]
    assert 0.2 < float(last["time"][-1]) < 0.26
    assert (whole["delta"][:count].values == last["delta"].values).all()
    turns = whole["delta"].values[count - 10 : count + 10, -1]
    bumps = np.abs(np.diff(turns, 2))
    assert bumps[8:10].max() < 2 * np.median(bumps)  # across the border as beside it
    run = load_scene(folder, "smoke")
    values = kinematics_values(run)
    assert values["contact_time"] > float(last["time"][-1])
    assert values["gap"].min() == pytest.approx(run.pinch.residual_gap, abs=1e-6)
    shapes = values["shape_gap"][values["shape_gap"] < 3e-3]
    assert (
        np.abs(np.diff(np.log(shapes))).max() < 0.25
    )  # of the mesh between the tips, a fifth from shape to shape
    assert couple.couple(scene, ranks=1, quiet=True) == folder


def test_a_pinch_that_ends_before_its_contact_is_coupled_as_a_whole(tmp_path, made):
    folder = couple.couple(pinch_of(tmp_path, 0.2), ranks=1, quiet=True)
    assert made[-1] == (folder.name, "smoke", "report")
    assert not list(folder.parent.glob("contact_*"))


def test_what_cannot_be_coupled_is_refused(tmp_path):
    (tmp_path / "scene.toml").write_text(
        f'extends = "{CASE}"\n[motion]\nsource = "paper_equations"\n'
    )
    with pytest.raises(StageError, match="COUPLED=1 takes fingers"):
        couple.couple(load_scene(tmp_path, "smoke"), ranks=1, quiet=True)


def test_a_run_is_made_whatever_scene_the_make_around_it_was_given(tmp_path, monkeypatch):
    """make compare-coupled SCENE=… leaves it in the environment of the make of each run, which has no such scene."""
    (tmp_path / "draft_1").mkdir()
    (tmp_path / "draft_1" / "scene.toml").write_text(f'extends = "{CASE}"\n')
    monkeypatch.setenv("SCENE", "single_finger")
    monkeypatch.setenv("COUPLED", "1")
    couple.make_run(tmp_path, "draft_1", "smoke", "kinematics", ranks=1, quiet=True)
    assert (tmp_path / "draft_1" / "out" / "smoke" / "kinematics.h5").exists()


def test_a_wider_tolerance_ends_with_fewer_runs(scene_of, made, tmp_path):
    """Of the tip's place and of the energy alike: a motion may be near where its energy is not."""
    counts = []
    for tolerance in (0.005, 0.02):
        shutil.rmtree(tmp_path / "out", ignore_errors=True)
        made.clear()
        more = f'[structure]\nfirst_motion = "prescribed"\ntolerance = {tolerance}\n'
        couple.couple(scene_of(more), ranks=1, quiet=True)
        counts.append(len(made))
    assert counts[1] < counts[0]
