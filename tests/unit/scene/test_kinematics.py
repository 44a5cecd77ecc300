"""Kinematics refuse what is no motion of a finger, and place it where the scene says."""

import numpy as np
import pytest

from pipeline.formats.bending_states import read_states
from pipeline.kinematics.pressure_law import absolute, measured_law
from pipeline.kinematics.stage import kinematics_values, run
from piv.files.errors import StageError
from tests.conftest import motion_of, write_scene

STROKE = "[motion]\nstrokes = [{{ pressure_kpa = {p}, start = 0.005, duration = 0.4 }}]\n{more}"


def csv_of(states, header="pressure_kpa,s,x,y"):
    """States (kPa -> (point, 3) of s, x, y) as the documented CSV."""
    lines = [header]
    for pressure, rows in states.items():
        lines += [",".join(f"{v:.9g}" for v in (pressure, *row)) for row in rows]
    return "\n".join(lines) + "\n"


def bent(gamma, length=0.07, n=30):
    s = np.linspace(0, length, n)
    k = max(gamma, 1e-9) / length
    return np.column_stack([s, np.sin(k * s) / k, 2 * np.sin(k * s / 2) ** 2 / k])


GOOD = {0: bent(0.0), 10: bent(0.8), 20: bent(1.6)}


def test_csv_states_give_the_bend_they_show(tmp_path):
    (tmp_path / "s.csv").write_text(csv_of(GOOD))
    states = read_states(tmp_path / "s.csv", 0.0145)
    assert states.pressure.tolist() == [0, 10e3, 20e3]
    more = STROKE.format(p=20, more=f'states = "{tmp_path / "s.csv"}"')
    kinematics = motion_of(write_scene(tmp_path / "scene", more=more)).shapes
    for kpa, gamma in ((0, 0.0), (10, 0.8), (20, 1.6)):
        # 30 digitised points have a chord error of (s/R)^2/24 of a point's turn: 1e-3 rad
        assert kinematics.bend(kpa * 1e3) == pytest.approx(gamma, abs=2e-3)


@pytest.mark.parametrize(
    "text, words",
    [
        (csv_of({0: GOOD[0], 10: GOOD[10]}), "at least three"),
        (csv_of(GOOD).replace("0.07", "nan", 1), "column s: 'nan' is not a finite"),
        (csv_of({k: v * 1e3 for k, v in GOOD.items()}), "mm"),
        (csv_of(GOOD, "p,s,x,y"), "header"),
        ("", "header"),
        ("pressure_kpa,s,x,y,thicknes\n0,0,0,0,1\n", "unknown column thicknes; did you mean"),
        ("pressure_kpa,s,x,y\n", "no rows below its header"),
        (csv_of(GOOD) + "30,0.01\n", "line 92: .* has 2 cells, the first row 4"),
        (csv_of(GOOD) + "30,a,b,c\n", "line 92, column s: 'a' is not a finite number"),
        (csv_of(GOOD) + "30,0,0,0\n", "four points"),
    ],
)
def test_bad_states_are_one_sentence(tmp_path, text, words):
    path = tmp_path / "s.csv"
    path.write_text(text)
    with pytest.raises(StageError, match=words) as caught:
        read_states(path, 0.0145)
    assert str(path) in str(caught.value)


def test_a_measured_pressure_beyond_the_states_names_its_file(tmp_path):
    (tmp_path / "p.csv").write_text("t,p\n0,0\n0.1,50000\n0.2,90000\n")
    scene = write_scene(tmp_path / "s", more='[motion]\npressure_csv = "../p.csv"')
    words = r"p.csv: the motion runs over 0…90 kPa but the states cover -40…40 kPa"
    with pytest.raises(StageError, match=words):
        motion_of(scene)


@pytest.mark.parametrize(
    "text, words",
    [
        ("t,p\n0,0\n0.1,5\n0.2,20\n", "kPa"),
        ("t,p\n0,0\n", "at least 2 rows"),
        ("0,hello\n1,x\n2,3\n", "first line is '0,hello'"),
        ("nan,nan\n0,0\n0.1,5000\n0.2,9000\n", "first line is 'nan,nan'"),
        ("p,t\n0,0\n0.1,5000\n0.2,9000\n", "first line is 'p,t'"),
        ("t [h],p\n0,0\n0.1,5000\n0.2,9000\n", r"first line is 't \[h\],p'"),
    ],
)
def test_bad_pressure_histories_are_one_sentence(tmp_path, text, words):
    with pytest.raises(StageError, match=r"^\S+q\.csv: no such file; give a table of t,p in s"):
        measured_law(tmp_path / "q.csv")
    (tmp_path / "p.csv").write_text(text)
    with pytest.raises(StageError, match=words):
        measured_law(tmp_path / "p.csv")


def test_a_history_that_begins_with_a_jump_of_its_slope_is_smoothed_or_warned_of(tmp_path, capsys):
    """The default smoothing starts from rest; without it, the first force is that of a jerk."""
    (tmp_path / "p.csv").write_text("t,p\n0,0\n0.1,3000\n0.2,6000\n0.4,12000\n")
    for name, more, warned in (("a", "", False), ("b", "smoothing = 0.0", True)):
        motion = f'[motion]\npressure_csv = "../p.csv"\n{more}\nend_time = 0.4'
        scene = write_scene(tmp_path / name, more=motion)
        scene.out.mkdir(parents=True)
        run(scene)
        text = capsys.readouterr().out
        assert ("p.csv begins with a jump of its slope" in text) is warned


def test_a_sensor_a_little_beyond_the_states_is_clipped_and_named(tmp_path, capsys):
    """States from 0 kPa, and −13 Pa at rest; 1 % of their range is 200 Pa."""
    (tmp_path / "s.csv").write_text(csv_of(GOOD))
    (tmp_path / "p.csv").write_text("t,p\n0,-13\n0.05,-13\n0.3,15000\n")
    more = STROKE.format(p=20, more=f'states = "{tmp_path / "s.csv"}"').replace("strokes", "#")
    scene = write_scene(
        tmp_path / "scene", more=f'{more}\npressure_csv = "{tmp_path / "p.csv"}"\nend_time = 0.3\n'
    )
    scene.out.mkdir(parents=True)
    run(scene)
    assert "warning" in (text := capsys.readouterr().out)
    assert "p.csv is up to 0.013 kPa beyond the states of 0 to 20 kPa: it is clipped" in text
    assert kinematics_values(scene)["pressure"].min() == 0.0
    (tmp_path / "p.csv").write_text("t,p\n0,-300\n0.3,15000\n")
    with pytest.raises(StageError, match=r"runs over -0\.3"):
        kinematics_values(scene)


def test_a_length_that_the_states_contradict_is_refused(tmp_path):
    with pytest.raises(StageError, match=r"finger\.length = 0\.06 m but the states"):
        motion_of(write_scene(tmp_path / "s", more="[finger]\nlength = 0.06\n"))


def test_a_stroke_beyond_the_states_or_out_of_the_water_is_refused(tmp_path):
    with pytest.raises(StageError, match="states cover"):
        motion_of(write_scene(tmp_path / "a", more=STROKE.format(p=60, more="")))
    tall = STROKE.format(p=39, more="[tank]\nwater_depth = 0.252\n[finger.tip]\nlength = 0.04\n")
    with pytest.raises(StageError, match="leaves the water"):
        kinematics_values(write_scene(tmp_path / "b", more=tall))
    suction = STROKE.format(p=-30, more='source = "paper_equations"')
    with pytest.raises(StageError, match=r"set motion\.source"):
        motion_of(write_scene(tmp_path / "c", more=suction))
    (tmp_path / "curl.csv").write_text(csv_of({0: bent(0.0), 10: bent(3.5), 20: bent(7.0)}))
    curled = STROKE.format(p=20, more=f'states = "{tmp_path / "curl.csv"}"')
    with pytest.raises(StageError, match="crosses itself"):
        kinematics_values(write_scene(tmp_path / "d", more=curled))


def test_the_finger_hangs_from_its_root_and_bends_to_its_ventral_side(tmp_path):
    for side, sign in (("+x", 1), ("-x", -1)):
        more = f'[finger]\nventral = "{side}"\nroot = [0.01, 0.24]\n'
        data = kinematics_values(write_scene(tmp_path / side, more=more))
        rest, bent_ = data["shape_outline"][[0, -1]]
        assert rest[:, 1].max() == pytest.approx(0.24, abs=1e-9)
        assert rest[:, 0].mean() == pytest.approx(0.01, abs=1e-4)
        assert sign * (bent_[:, 0].mean() - 0.01) > 0.01
        dorsal = data["shape_dorsal_direction"][0]
        assert dorsal == pytest.approx([-sign, 0], abs=1e-9)
        assert np.ptp(rest[:, 0]) == pytest.approx(data["tip_thickness"], abs=1e-9)
        assert data["shape_tip_direction"][0] == pytest.approx([0, -1], abs=1e-9)


def test_an_absolute_pressure_is_warned_of(tmp_path):
    (tmp_path / "p.csv").write_text("t,p\n0,101300\n0.3,116300\n")
    assert "p.csv begins at 101.3 kPa, as absolute pressures do" in absolute(tmp_path / "p.csv")
    (tmp_path / "p.csv").write_text("t,p\n0,60000\n0.3,116300\n")
    assert not absolute(tmp_path / "p.csv")
