"""Pressure, structure and flow told apart, where the pressure in the chambers was measured."""

from dataclasses import replace

import numpy as np
import pytest

from fileio.checksum import sha256
from fileio.errors import StageError
from fileio.formats.elastic_motion import write_elastic_motion
from fileio.formats.finger_loads import write_loads
from fileio.formats.kinematics import read_kinematics, write_kinematics
from fileio.formats.records import LAB_COMPARISON
from pipeline.kinematics.stage import kinematics_values
from pipeline.scene.scene import load_scene
from pipeline.structure.coupling import motion_values
from pipeline.study.couple import Structure
from postprocess.evidence.stage_files import StageFiles
from postprocess.lab.data.dpiv_toml import NAME, read_dpiv
from postprocess.lab.data.files import (
    NO_NUISANCE,
    LabFiles,
    Law,
    Registration,
    write_registration,
)
from postprocess.lab.data.pose import Pose
from postprocess.lab.judgement import causes as causes_module
from postprocess.lab.judgement.causes import (
    causes,
    coupled_run,
    sentences,
    write_modelled,
    write_scene,
)
from tests.lab_scene import CASE, finger_kinematics
from tests.unit.lab.test_lab_dpiv import WHOLE, written

DELAY = 0.1  # s, of the simulation's clock after the recording's
TIME = np.linspace(0.0, 0.42, 43)
PRESSURE = '\npressure = { csv = "p.csv", std_kpa = 0.1 }\n'


@pytest.fixture
def lab(tmp_path):
    """A scene, and a recording of it: p.csv is the scene's own pressure."""
    case = tmp_path / "finger"
    (case / "reference").mkdir(parents=True)
    (case / "kinematics").symlink_to(CASE / "kinematics")
    (case / "scene.toml").write_text(f'extends = "{CASE}"\ntitle = \'A "soft" finger\'\n')
    (case / "reference" / "inputs.toml").write_text(
        'format = "inputs"\nformat_version = 1\ntoo_uncertain = 0.3\n'
    )
    (case / "out" / "smoke").mkdir(parents=True)
    kinematics = finger_kinematics(case / "out" / "smoke")
    data = tmp_path / "run7"
    data.mkdir()
    text = WHOLE.replace('"nominal"', '"measured"') + PRESSURE
    with pytest.raises(ValueError, match=r"pressure is on the camera's clock, .* give start = "):
        read_dpiv(written(data, text))
    stated = f"start = {{ at_s = {-DELAY}, std_s = 0.001 }}"
    dpiv = read_dpiv(written(data, text.replace('start = "from motion"', stated)))
    pressure_csv(data, kinematics, 1.0)
    files = LabFiles(StageFiles(case, "smoke"), dpiv.name)
    modelled = files.of_scene("modelled")
    modelled.folder.mkdir(parents=True)
    finger_kinematics(modelled.stage.out)
    return files, dpiv, kinematics


def pressure_csv(folder, kinematics, factor, noise=0.0):
    time = np.linspace(-0.02, 0.45, 471)
    p = factor * kinematics.law(np.clip(time, *kinematics.time))
    p += noise * np.random.default_rng(1).standard_normal(time.size)
    rows = [f"{t + DELAY:.6g},{value:.6g}" for t, value in zip(time, p, strict=True)]
    (folder / "p.csv").write_text("t,p\n" + "\n".join(rows) + "\n")


def moved(files, kinematics, recorded_by, coupled_by, delay=DELAY, left=2e-3):
    """What is registered, and a coupled run, each so many rad beside the scene's bend; `delay` (s): the registration's clock;
    `left` (rad): what another run would change."""
    modelled = files.of_scene("modelled")
    bend = kinematics.bend(kinematics.law(TIME))
    pose, turn = Pose(1.25e-4, 0.0, kinematics.root, (640.0, 950.0)), np.radians(0.05)
    law = Law(np.array([1.0, delay, 1.0]), np.diag([1e-3, 1e-3, 1e-3]) ** 2, 1.0)
    covariance = np.diag([0.1, 0.1, turn, 1e-3]) ** 2
    seen = TIME + DELAY, kinematics.pressure_of_bend(bend + recorded_by), np.full(TIME.size, 50.0)
    write_registration(
        Registration(pose, covariance, NO_NUISANCE, law, *seen, pose),
        modelled.registration,
        dpiv_sha256="0",
        seed=1,
        view=pose.view((0.0, 0.0), (1280.0, 1024.0), 0.0),
    )
    modelled.motion.write_text(f"of a motion {recorded_by} rad off")
    still = {name: np.zeros((3, 4)) for name in ("profile_x", "profile_y", "thickness")}
    run = files.folder / "pressure" / "out" / "coupled" / "smoke_2"
    (run / "out" / "smoke").mkdir(parents=True, exist_ok=True)
    values = {"step": TIME, "bend": bend + coupled_by, "bend_unloaded": bend, "unknown": ""}
    write_loads(run / "out" / "smoke", values, {})
    motion = {
        "time": TIME,
        "pressure": 0 * TIME,
        "delta": np.zeros((43, 2)),
        "knot": np.arange(3.0),
    }
    # the run before had changed it by far more
    made = still | {"made_of": "", "tip_change": 1e-2, "bend_change": 0.5}
    write_elastic_motion(run / "elastic_motion.h5", made | motion)
    write_elastic_motion(run / "after.h5", made | motion | {"delta": motion["delta"] + [0.0, left]})


def test_the_scene_has_the_measured_pressure_on_the_simulations_clock(lab):
    """A sensor's noise would shake the chain: of 100 Pa in each sample a third is left, of 470 samples of a smooth history."""
    files, dpiv, kinematics = lab
    for noise, most in ((0.0, 30), (100.0, 80)):
        pressure_csv(dpiv.folder, kinematics, 1.0, noise)
        scene = load_scene(write_scene(files, dpiv), "smoke")
        assert scene.motion.strokes == ()
        assert scene.title == 'A "soft" finger, at the pressure of the recording run7'
        structure = Structure(scene)  # what COUPLED=1 makes of it
        assert (
            np.abs(structure.pressure - kinematics.law(structure.time)).max() < most
        )  # Pa, of 20 kPa


def test_the_clock_is_the_stated_one(lab):
    """The registration, which fits the scene's own motion to a finger that moves otherwise, is 30 ms off it."""
    files, dpiv, kinematics = lab
    write_scene(files, dpiv)
    moved(files, kinematics, 0.0, 0.0, delay=DELAY + 0.03)
    table = causes(files, dpiv).set_index("cause")
    assert list(table.verdict) == ["agrees", "agrees", "not judged"]
    assert table.difference["pressure"] < 50  # Pa
    assert table.difference["structure"] < 2e-3  # rad: between pictures 10 ms apart


def test_an_uncertain_clock_hides_what_it_may_explain(lab):
    """20 ms at the stroke's mean rate of 35 kPa/s: 1 kPa more or less pressure cannot be told."""
    files, dpiv, kinematics = lab
    pressure_csv(dpiv.folder, kinematics, 1.1)
    write_scene(files, dpiv)
    moved(files, kinematics, 0.1, 0.1)
    assert causes(files, dpiv).verdict[0] == "differs"
    text = (dpiv.folder / "dpiv.toml").read_text().replace("std_s = 0.001", "std_s = 0.02")
    assert causes(files, read_dpiv(written(dpiv.folder, text))).verdict[0] == "agrees"


@pytest.mark.parametrize(
    "factor, recorded_by, coupled_by, words",
    [
        (1.0, 0.0, 0.001, ("agrees", "agrees")),
        (1.1, 0.1, 0.101, ("differs", "agrees")),  # another pressure explains the motion
        (1.0, 0.0, 0.1, ("agrees", "model error")),  # at the same pressure it moves otherwise
    ],
)
def test_causes_are_told_apart(lab, factor, recorded_by, coupled_by, words):
    files, dpiv, kinematics = lab
    pressure_csv(dpiv.folder, kinematics, factor)
    write_scene(files, dpiv)
    moved(files, kinematics, recorded_by, coupled_by)
    table = causes(files, dpiv).set_index("cause")
    assert (table.verdict["pressure"], table.verdict["structure"], table.verdict["flow"]) == (
        *words,
        "not judged",
    )
    assert (files.folder / "causes.csv").exists()


def test_a_coupled_motion_becomes_that_of_a_recording(lab):
    """It swings back by a tenth at its end: its bend over time is kept, and its shapes are those of the way out."""
    files, dpiv, _ = lab
    scene = load_scene(write_scene(files, dpiv), "smoke")
    structure = Structure(scene)
    delta = structure.first()  # under the modelled water
    run = files.folder / "pressure" / "out" / "coupled" / "smoke_1"
    (run / "out" / "smoke").mkdir(parents=True)
    bend = structure.chain.bend(structure.pressure, delta)
    assert bend.max() - bend[-1] > 0.08
    write_loads(run / "out" / "smoke", {"step": structure.time, "bend": bend, "unknown": ""}, {})
    values = motion_values(structure.chain, structure.time, structure.pressure, delta, None)
    write_elastic_motion(run / "elastic_motion.h5", values | {"made_of": ""})
    folder = write_modelled(files, dpiv)
    text = f'extends = "{CASE}"\n[motion]\nsource = "structure"\nshapes = "elastic_motion.h5"\n'
    (run / "scene.toml").write_text(text)
    made, coupled = (kinematics_of(load_scene(of, "smoke")) for of in (folder, run))
    assert made.data.attrs["source"] == "recording"
    for time in np.linspace(0.0, 0.42, 22):
        parameter = float(made.law(time))
        # rad and m; shapes are 1° apart
        assert made.shape("bend", parameter) == pytest.approx(
            float(coupled.shape("bend", time)), abs=2e-3
        )
        off = made.shape("outline", parameter) - coupled.shape("outline", time)
        # the way back has other shapes at the same bend: 1.2 mm at the tip
        assert np.abs(off).max() < (5e-5 if time < structure.time[np.argmax(bend)] else 1.5e-3)


def kinematics_of(scene):
    path = scene.folder / "kinematics.h5"
    write_kinematics(path, kinematics_values(scene), {})
    return read_kinematics(path)


def test_a_large_uncertainty_hides_the_answer(lab):
    files, dpiv, kinematics = lab
    write_scene(files, dpiv)
    moved(files, kinematics, 0.0, 0.1)
    text = (dpiv.folder / "dpiv.toml").read_text().replace("std_kpa = 0.1", "std_kpa = 5.0")
    table = causes(files, read_dpiv(written(dpiv.folder, text)))
    assert list(table.verdict) == ["too uncertain", "too uncertain", "not judged"]


def test_what_another_coupled_run_would_change_is_not_known_of_the_structure(lab):
    """0.1 rad (6°) apart: more than 0.02 rad explains, less than 0.1 rad does."""
    files, dpiv, kinematics = lab
    write_scene(files, dpiv)
    for left, word in ((0.02, "model error"), (0.1, "agrees")):
        moved(files, kinematics, 0.0, 0.1, left=left)
        row = causes(files, dpiv).iloc[1]
        assert row.verdict == word
        assert row.dominant == "coupling"
        others = 1.96 * np.hypot(np.radians(0.05), 0.0075)  # turn, and 0.1 kPa of 20
        assert row.band == pytest.approx(np.hypot(1.96 * left, others), rel=0.02)
    (coupled_run(files).parents[1] / "after.h5").unlink()
    with pytest.raises(StageError, match=r"holds no after\.h5, .* make compare-coupled again"):
        causes(files, dpiv)


def test_causes_agree_only_where_an_error_would_have_been_found(lab):
    """The pressure known to 2 kPa: its band of 3.9 kPa is below 30 % of 20 kPa, but only an error of 7.2 would be found."""
    files, dpiv, kinematics = lab
    write_scene(files, dpiv)
    moved(files, kinematics, 0.0, 0.0)
    text = (dpiv.folder / "dpiv.toml").read_text().replace("std_kpa = 0.1", "std_kpa = 2.0")
    row = causes(files, read_dpiv(written(dpiv.folder, text))).iloc[0]
    assert row.verdict == "too uncertain"
    assert row.band < 6000 < row.detectable


def test_the_command_that_judges_the_flow_takes_the_scene_that_is_registered(lab):
    """Against the scene's own motion a finger that water bends is refused."""
    files, dpiv, kinematics = lab
    write_scene(files, dpiv)
    moved(files, kinematics, 0.0, 0.0)
    told = sentences(causes(files, dpiv), files, dpiv)[2]
    home, scene = files.stage.scene_folder.parent, "finger/out/smoke/lab/run7/modelled"
    assert (
        f"make compare-measured CASES={home} SCENE={scene} LEVEL=smoke DPIV={dpiv.folder}" in told
    )


def test_what_the_last_step_needs_is_asked_for_before_anything_is_solved(lab, monkeypatch):
    files, dpiv, _ = lab
    text = (dpiv.folder / "dpiv.toml").read_text()
    nominal = read_dpiv(written(dpiv.folder, text.replace('"measured"', '"nominal"')))
    known = causes_module.read

    def without_stiffness(path):
        return replace(known(path), law=None)

    monkeypatch.setattr(causes_module, "read", without_stiffness)
    with pytest.raises(StageError, match="carries no bending_stiffness_std"):
        write_scene(files, nominal)
    write_scene(files, dpiv)  # a finger whose geometry was measured needs no band
    (files.stage.scene_folder / "reference" / "inputs.toml").unlink()
    with pytest.raises(FileNotFoundError, match="says how well the simulation's inputs are known"):
        write_scene(files, dpiv)


def test_the_flow_is_that_of_the_measured_motion(lab):
    files, dpiv, kinematics = lab
    write_scene(files, dpiv)
    moved(files, kinematics, 0.0, 0.0)
    modelled = files.of_scene("modelled")
    judged = modelled.of_scene("measured").comparison
    judged.parent.mkdir(parents=True)
    driven_by = {"../motion.h5": sha256(modelled.motion)[:16]}
    values = kinematics_values(load_scene(CASE, "smoke"))
    run = judged.parents[2] / "kinematics.h5"
    write_kinematics(run, values, kinematics.settings | {"files": driven_by})
    stated = {"dpiv_sha256": sha256(dpiv.folder / NAME)}
    LAB_COMPARISON.write(judged, {"flow": "model error", "provenance": stated})
    told = sentences(causes(files, dpiv), files, dpiv)
    assert told[2] == "flow: model error, with the recording's own motion"
    LAB_COMPARISON.write(
        judged, {"flow": "model error", "provenance": {"dpiv_sha256": "of another"}}
    )
    assert causes(files, dpiv).verdict[2] == "not judged"
    LAB_COMPARISON.write(judged, {"flow": "model error", "provenance": stated})
    moved(
        files, kinematics, 0.01, 0.0
    )  # registered again: another motion than that of the comparison
    assert causes(files, dpiv).verdict[2] == "not judged"


def test_bands_of_the_bending_analysis_count_for_a_nominal_finger(lab):
    """What is not known of stiffness and shape explains 5°, and not 40°; an error of 30 % of the stroke (26°) it would hide."""
    files, dpiv, kinematics = lab
    write_scene(files, dpiv)
    text = (dpiv.folder / "dpiv.toml").read_text()
    for off, measured, nominal in (
        (5, "model error", "too uncertain"),
        (40, "model error", "model error"),
    ):
        moved(files, kinematics, 0.0, np.radians(off))
        assert causes(files, dpiv).verdict[1] == measured
        other = read_dpiv(written(dpiv.folder, text.replace('"measured"', '"nominal"')))
        row = causes(files, other).iloc[1]
        assert (row.verdict, row.dominant) == (nominal, "shape")
        assert np.radians(5) < row.band < 0.3 * 1.52 < row.detectable
        written(dpiv.folder, text)


def test_what_is_missing_is_told(lab):
    files, dpiv, kinematics = lab
    write_scene(files, dpiv)
    moved(files, kinematics, 0.0, 0.0)
    (
        files.folder / "pressure" / "out" / "coupled" / "smoke_2" / "out" / "smoke" / "loads.h5"
    ).unlink()
    with pytest.raises(
        StageError, match="holds no coupled run of level smoke; make compare-coupled"
    ):
        causes(files, dpiv)
    with pytest.raises(
        StageError, match="vectors do not show the finger; make compare-coupled takes pictures"
    ):
        write_scene(files, dpiv.model_copy(update={"kind": "vectors"}))
    bare = read_dpiv(written(dpiv.folder, WHOLE))
    with pytest.raises(StageError, match=r"says no pressure; give pressure = \{ csv = "):
        write_scene(files, bare)
    (dpiv.folder / "p.csv").write_text("t,p\n0.1,0\n0.2,1e3\n0.3,2e3\n0.4,3e3\n0.5,4e3\n")
    with pytest.raises(
        StageError, match=r"must reach from 0\.1 s, where the motion begins .* to 0\.52 s"
    ):
        write_scene(files, dpiv)
