"""The recording's motion in changes of the runs, and the part of S − D that it explains."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from scipy.interpolate import CubicSpline

from pipeline.formats.kinematics import SHAPE
from piv.formats.plane_series import make_plane
from piv.vortices.find import VortexSettings
from postprocess.lab.flow import corrected, of_recorded_motion, run_sources
from postprocess.lab.inputs import Input
from postprocess.lab.motion import (
    Comparison,
    Effect,
    check_rate,
    difference,
    final_bend,
    over_bend,
    recorded_bend,
    stroke_duration,
    with_speeds,
)
from postprocess.lab.pose import Pose
from postprocess.lab.register import Law, Registration
from postprocess.lab.virtual_experiment import Sides
from tests.lab_scene import finger_kinematics

FACTOR, STRETCH = 1.05, 0.9
COLUMNS = ["circulation"]
ROWS = np.arange(3)


@pytest.fixture(scope="module")
def case(tmp_path_factory):
    """A recording with 5 % more bend in 10 % less time; runs of pressure and duration."""
    kinematics = finger_kinematics(tmp_path_factory.mktemp("motion"))
    law = Law(np.array([FACTOR, 0.0, STRETCH]), np.diag([2e-3, 5e-4, 4e-3]) ** 2)
    pose, some = Pose(0.1, 0.0, kinematics.root, (0.0, 0.0)), np.zeros(3)
    registration = Registration(pose, np.eye(4), law, some, some, pose)
    bend = final_bend(kinematics, 1.02) - final_bend(kinematics, 1.0)
    runs = (
        (input_of("pressure"), 3e-5, bend, 0.0),
        (input_of("duration"), -10e-5, 0.0, 0.1 * stroke_duration(kinematics)),
    )
    effects = [
        Effect(of, b, d, pd.DataFrame({"circulation": [c] * 3, "x": 0.0, "y": 0.0}))
        for of, c, b, d in runs
    ]
    paired = SimpleNamespace(piv=SimpleNamespace(pairing="1-2,3-4"), folder=Path("recording"))
    return Comparison(paired, kinematics, registration, 0.02, None, effects)


def input_of(name):
    return Input(name=name, key=name, step=1.0, limit=0.5 * 3**0.5, reason="")


@pytest.mark.parametrize("factor, found", [(1.003, (0.0, 0.0)), (FACTOR, None)])
def test_a_run_that_hardly_bends_the_finger_tells_nothing_of_its_bend(case, factor, found):
    law = replace(case.registration.law, values=np.array([factor, 0.0, 1.0]))
    effect = replace(case.effects[0], bend=1e-4)
    seen = replace(case.registration, law=law)
    made = recorded_bend(replace(case, registration=seen, effects=[effect]))
    assert made == found if found is None else made[1:] == found


def test_another_motion_differs_by_its_bend_and_duration(case, tmp_path):
    """8 % more pressure in 10 % less time, beginning 20 ms later: known by its bend alone."""
    stroke = {"pressure_kpa": 21.6, "start": 0.025, "duration": 0.36}
    other = finger_kinematics(tmp_path, {"motion.strokes": [stroke]})
    bend, duration = difference(case.kinematics, other)
    bent = final_bend(case.kinematics, 1.08)
    assert bend == pytest.approx(bent - final_bend(case.kinematics), rel=0.01)
    # the nominal law ends at 0.42 s, which is 0.44 s in its time
    assert duration == pytest.approx(-0.1 * stroke_duration(case.kinematics), rel=0.02)


def over_time(own, pressure):
    """The kinematics of a coupled run: shapes over time, those at a `pressure` over it."""
    times = np.linspace(0.0, 0.42, 85)
    shapes = {name: own.shape(name, pressure(times)) for name in own.splines}
    rows = {f"shape_{n}": (own.data[f"shape_{n}"].dims, v) for n, v in shapes.items()}
    return replace(
        own,
        data=own.data.drop_dims(SHAPE).assign(rows).assign_coords({SHAPE: times}),
        law=CubicSpline(times, times),
        splines={name: CubicSpline(times, values) for name, values in shapes.items()},
    )


def test_a_motion_that_swings_back_is_known_over_its_bend(case):
    own = case.kinematics

    def pressure(t):
        return 10e3 * (1 - np.cos(2 * np.pi * t / 0.7)) * (1 + 0.2 * t)

    made = over_bend(over_time(own, pressure))
    assert made.low == 0
    assert (np.diff(made.data["shape_bend"]) > 0).all()
    at = np.linspace(0.05, 0.42, 50)
    # shapes lie a hundredth of the bend apart: 1 mm at the tip, to fourth order
    np.testing.assert_allclose(
        made.shape("outline", made.law(at)), own.shape("outline", pressure(at)), atol=2e-5
    )


def test_on_the_way_back_the_nearest_shape_counts(case):
    """A tip that is 1 mm further on while the finger swings back: as a silhouette shows it."""
    own = case.kinematics
    motion = over_time(own, lambda t: 10e3 * (1 - np.cos(2 * np.pi * t / 0.72)))
    made, tip = over_bend(motion), motion.splines["tip"]
    times, back = tip.x, tip.x > 0.37
    onward = made.shape("tip", made.law(times) + 1e-3) - made.shape("tip", made.law(times))
    size = np.linalg.norm(onward, axis=1)  # m for a mrad
    moved = tip(times) + np.where(back, 1e-3 / size, 0)[:, None] * onward
    off = replace(motion, splines=motion.splines | {"tip": CubicSpline(times, moved)})
    further = over_bend(off).law(times) - made.law(times)
    assert further[back] == pytest.approx(1e-6 / size[back], rel=0.02)
    assert further[times < 0.35] == pytest.approx(0.0, abs=1e-4)


def test_a_finger_that_bends_to_both_sides_is_refused(case):
    with pytest.raises(ValueError, match="bends to one side, and this one bends to both"):
        over_bend(over_time(case.kinematics, lambda t: 10e3 * np.sin(2 * np.pi * t / 0.4)))


def test_it_takes_the_place_of_the_inputs_bands(case):
    blind = replace(case, registration=replace(case.registration, times=np.zeros(0)))
    names = [source.name for source in run_sources(blind, COLUMNS, ROWS)]
    assert names == ["pressure", "duration", "geometry and material"]
    # the recording's flow is stronger by 2.5 runs of pressure; at equal phase, by 1/0.9 of speed
    times = np.array([0.1, 0.2, 0.3])
    table = pd.DataFrame({"time": times, "circulation": 0.1 * times, "x": times, "y": 0.0})
    seen = {"measured": {"virtual": table, "direct": table}}
    moved = replace(case, **seen)
    std = {s.name: s.std[0] for s in run_sources(moved, COLUMNS, ROWS[:2])}
    assert set(std) == {"pressure as recorded", "duration as recorded"}
    # both sides have the recording's duration: S has the bend alone, `moved` has both
    found = corrected(moved)
    assert found["circulation"].to_numpy() == pytest.approx(0.1 * times + 2.5 * 3e-5, rel=0.01)
    assert found["x"].to_numpy() == pytest.approx(times)
    changed = of_recorded_motion(moved)[1]["circulation"].to_numpy()
    assert changed == pytest.approx(
        [np.nan, *(0.1 * times - 0.1 * times * 0.9**2)[1:]], nan_ok=True
    )
    assert std["pressure as recorded"] == pytest.approx(3e-5 * 2e-3 / 0.02, rel=0.02)
    for unknown in (blind, replace(case, effects=case.effects[1:])):  # no pictures, no run
        assert corrected(replace(unknown, **seen)).equals(table)
    # the growth goes with the square of the speed; at 0.1 s a longer stroke is not known
    assert std["duration as recorded"] == pytest.approx(2 * 0.1 * 0.2 * 0.004 / 0.9, rel=0.01)


def beside(kinematics, speed, stretch):
    """Water that goes with the pressure's rate, a stroke of `stretch` times the duration."""
    x, y = np.linspace(-0.04, 0.09, 40), np.linspace(0.14, 0.26, 37)
    times = np.linspace(0.02, 0.40, 20) * stretch
    phase = times / stretch
    u = speed * np.ones((1, 37, 40)) * np.abs(kinematics.law(phase, 1))[:, None, None] * 1e-6
    outline = kinematics.shape("outline", kinematics.law(phase))[:, None]
    return make_plane(x, y, u, 0 * u, time=times, valid=np.ones(u.shape, bool), outline=outline)


@pytest.mark.parametrize(
    "speed, stretch, refused, constant",
    [
        pytest.param(1.0, 1.0, "", None, id="right"),
        pytest.param(1 / 0.85, 0.85, "", None, id="a stroke 15 % shorter"),
        pytest.param(1 / 1.15, 1.15, "", None, id="a stroke 15 % longer"),
        pytest.param(1.0, 1 / 1.3, "about 1.30 times the true one", 0.77, id="rate stated high"),
        pytest.param(1.0, 1.15, "about 0.87 times the true one", 1.15, id="rate stated low"),
        pytest.param(0.84, 1.0, "", 0.84, id="interval"),
    ],
)
def test_a_rate_is_told_from_a_stroke_of_another_duration(case, speed, stretch, refused, constant):
    law = replace(case.registration.law, values=np.array([1.0, 0.0, stretch]))
    made = replace(case, registration=replace(case.registration, law=law))
    ours = beside(case.kinematics, 1 / stretch, stretch)
    sides = Sides(beside(case.kinematics, speed, stretch), ours, ours, VortexSettings(0.004), 0.01)
    made = with_speeds(made, sides)
    assert made.all_water == (constant and pytest.approx(constant, abs=0.01))
    if refused:
        with pytest.raises(ValueError, match=f"dpiv.toml: frame_rate_hz is {refused}"):
            check_rate(made)
    else:
        check_rate(made)
