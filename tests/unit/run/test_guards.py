"""A run that goes wrong is stopped, one that does not is left alone; what cannot work is refused before it starts."""

import re
import time

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fileio.errors import StageError
from pipeline.run.energy import ENERGY_TOLERANCE, HALVE, Budget, EnergyGuard, energy_budget
from pipeline.run.guards import Guard, Watchdog
from pipeline.run.solver import LOG, failed
from pipeline.scene.limits import check_courant
from pipeline.scene.predicted import estimated_cells
from pipeline.scene.scene import load_scene
from tests.conftest import ROOT, write_scene

STEP = (
    "Courant Number mean: 0.1 max: {courant}\nTime = {time}\n\n"
    "smoothSolver:  Solving for Ux, Initial residual = {residual}, Final residual = 1e-9, No Iterations 2\n"
    "GAMG:  Solving for p, Initial residual = 0.8, Final residual = 0.01, No Iterations {iterations}\n"
    "time step continuity errors : sum local = {local}, global = -2e-10, cumulative = 1e-9\n"
)
SOUND = {"courant": 0.5, "time": 0.1, "residual": 0.3, "iterations": 7, "local": 1e-8}


def verdicts(guard, **changes):
    lines = STEP.format(**SOUND | changes).splitlines()
    return [cause for line in lines if (cause := guard.verdict(line))]


@pytest.mark.parametrize(
    "changes, words",
    [
        ({"courant": 21}, "Courant number 21"),
        ({"courant": "nan"}, "Courant number nan"),
        ({"local": 0.5}, "continuity error 0.5"),
        ({"local": "nan"}, "continuity error nan"),
        ({"residual": "nan"}, "equations for Ux have no number"),
        ({"residual": "-inf"}, "equations for Ux have no number"),
    ],
)
def test_the_log_of_a_step_gone_wrong_is_a_cause_and_a_sound_one_is_none(changes, words):
    guard = Guard(20.0)
    assert verdicts(guard) == []
    assert guard.time == 0.1
    causes = verdicts(guard, **changes)
    assert len(causes) == 1
    assert words in causes[0]


def test_an_openfoam_without_a_function_object_is_told():
    """It warns and goes on; the forces would be missed at the end."""
    guard = Guard(10)
    assert (
        guard.verdict("Unknown function type forces\n") == "OpenFOAM has no function object forces"
    )
    assert "install the whole" in guard.remedy


def test_a_pressure_that_never_converges_stops_the_run_after_some_steps():
    guard = Guard(20.0)
    causes = [verdicts(guard, iterations=1000) for _ in range(7)]
    assert causes[:5] == [[]] * 5
    assert "did not converge in 5 steps" in causes[5][0]
    assert verdicts(Guard(20.0), iterations=1000) == []


def feed(budget, times, power, kinetic, dissipation=None):
    """Index of the first sample at which there is energy from nothing, or None."""
    lost = np.zeros(len(times)) if dissipation is None else dissipation
    samples = zip(times, power, kinetic, lost, strict=True)
    return next((k for k, s in enumerate(samples) if budget.add(*s) is not None), None)


def stroke(loss=0.3, n=200):
    """A stroke's power, and the kinetic energy that is left of its work where a part is lost."""
    times = np.arange(1, n + 1) / n
    power = np.sin(np.pi * times) ** 2 - 0.2 * np.sin(2 * np.pi * times) ** 2
    work = np.cumsum(power) / n
    return times, power, (1 - loss) * work


def test_energy_that_work_accounts_for_passes_whatever_is_lost():
    for loss in (0.0, 0.3, 0.9):
        assert feed(Budget(1e-6), *stroke(loss)) is None


@pytest.mark.parametrize("jump", [0.1, 1.0])
def test_energy_from_nothing_is_found_even_below_all_the_work_so_far(jump):
    """Dissipation hides in the total: after 60 % were lost, the energy may not rise again by itself."""
    times, power, kinetic = stroke(0.6)
    kinetic = kinetic.copy()
    kinetic[150:] += jump * kinetic[150]
    at = feed(Budget(1e-6), times, power, kinetic)
    excess = jump * kinetic[149]
    if excess > 1.1 * ENERGY_TOLERANCE * np.cumsum(power)[150] / 200:
        assert at == 150
    else:
        assert at is None


def test_a_flow_that_is_there_before_the_finger_moves_is_found():
    """The trap of a mesh that jumps in its first step: half a metre per second everywhere, and no work for it."""
    times, power, kinetic = stroke()
    assert feed(Budget(1e-3), times, power, kinetic + 0.05) == 0


def test_growth_without_motion_and_numbers_that_are_none_are_found():
    budget = Budget(1e-6)
    assert budget.add(0.1, 1.0, 0.05, 0.0) is None
    grown = [budget.add(0.1 + 0.01 * k, 0.0, 0.05 * 1.02**k, 0.0) for k in range(1, 20)]
    assert any(g is not None for g in grown)
    for sample in ((np.nan, 1.0, 0.0), (1.0, np.nan, 0.0), (1.0, np.inf, 0.0), (1.0, 1.0, np.inf)):
        assert Budget(1.0).add(0.1, *sample) == np.inf


def test_dissipation_that_no_work_pays_for_is_found_and_a_stroke_in_a_thick_fluid_is_left_alone():
    """The end of a real run that closed to -46 % (docs/stability.md, the corner of 2 ms and 1e-3 m²/s): the wall's power
    alternates, what it feeds is dissipated at once, and the kinetic energy alone looks sound."""
    times = 0.04 + 0.002 * np.arange(1, 11)
    power = [-0.895, 0.691, -0.755, 0.679, -0.788, 0.802, -0.943, 1.011, -1.178, 1.339]
    kinetic = [0.0367, 0.0348, 0.0330, 0.0314, 0.0300, 0.0286, 0.0278, 0.0272, 0.0275, 0.0303]
    dissipation = [1.030, 0.983, 0.996, 1.102, 1.379, 2.039, 3.257, 6.301, 11.16, 25.62]
    for lost, step in ((dissipation, 8), (np.zeros(10), None)):
        budget = Budget(1e-6, work=0.14, largest=0.14)
        budget.begin(0.04, 0.970, 0.0389, 1.102)
        budget.least -= budget.work
        assert feed(budget, times, power, kinetic, lost) == step
    times, power, kinetic = stroke(0.9)
    paid = 0.85 * power  # of the 90 % that are lost
    assert feed(Budget(1e-6), times, power, kinetic, np.maximum(paid, 0.0)) is None


def square(size=0.02):
    return size * np.array([[0.0, 0], [1, 0], [1, 1], [0, 1]])


def test_an_impulsive_start_is_known_from_the_walls_motion_and_not_held_against_the_run():
    steps = np.arange(41) * 1e-3
    smooth = square()[None] + np.stack([0.3 * steps**3 / steps[-1] ** 2, 0 * steps], -1)[:, None]
    sudden = square()[None] + np.stack([0.3 * steps, 0 * steps], -1)[:, None]
    for positions, allowed in ((smooth, False), (sudden, True)):
        budget = energy_budget(positions, steps, 0.03, 1000.0)
        energy = 0.5 * 1000 * 0.3**2 * 0.02**2 * 0.03
        assert (budget.add(2e-3, 0.0, energy, 0.0) is None) == allowed
        assert (
            budget.add(20e-3, 0.0, 2 * energy, 0.0) is None
        ) is False  # a later jump is none of the wall's


def test_samples_are_read_as_they_come_and_a_cut_line_waits(tmp_path):
    volumes = tmp_path / "volumes" / "0" / "volFieldValue.dat"
    volumes.parent.mkdir(parents=True)
    for name in ("0.002", "0.004", "0.006"):
        surface = tmp_path / "fingerSurface" / name / "finger.vtk"
        surface.parent.mkdir(parents=True)
        surface.touch()
    seen = []

    def rate(path, density):
        seen.append(path.parent.name)
        return 1.0

    guard = EnergyGuard(tmp_path, 1000.0, 1e-6, Budget(1e-9), work_rate=rate)
    assert guard.check() is None
    volumes.write_text("# Time\n0.002\t1e-6 0 0\n0.004\t2e-6 0 0\n0.006\t1")
    assert guard.check() is None
    assert seen == ["0.002"]  # the second may still be without its surface
    volumes.write_text("# Time\n0.002\t1e-6 0 0\n0.004\t2e-6 0 0\n0.006\t1.0 0 0\n")
    assert guard.check() is None
    assert "500 J of kinetic energy" in guard.check(ended=True)
    assert seen == ["0.002", "0.004", "0.006"]


def test_a_resumed_run_begins_with_the_energy_it_finds(tmp_path):
    table = tmp_path / "volumes" / "0.3" / "volFieldValue.dat"
    table.parent.mkdir(parents=True)
    table.write_text("0.302 1.0 0 0\n0.304 0.99 0 0\n0.306 1.2 0 0\n")
    for name in ("0.302", "0.304", "0.306"):
        (tmp_path / "fingerSurface" / name).mkdir(parents=True)
        (tmp_path / "fingerSurface" / name / "finger.vtk").touch()
    guard = EnergyGuard(
        tmp_path, 2.0, 0.0, Budget(1e-9), from_rest=False, work_rate=lambda path, density: 0.0
    )
    assert "1.2 J of kinetic energy and has dissipated 0 J, 0.21 J more" in guard.check(ended=True)


def test_the_resolved_dissipation_of_the_samples_is_held_against_the_work(tmp_path):
    """1000 kg/m³ and 1e-3 m²/s: the integrals 5 and 2 1/s² m³ are 6 W, for which nothing was done; the step is to be halved."""
    table = tmp_path / "volumes" / "0" / "volFieldValue.dat"
    table.parent.mkdir(parents=True)
    table.write_text("0.1 1e-6 5 2\n0.2 1e-6 5 2\n")
    for name in ("0.1", "0.2"):
        (tmp_path / "fingerSurface" / name).mkdir(parents=True)
        (tmp_path / "fingerSurface" / name / "finger.vtk").touch()
    for viscosity, stops in ((1e-3, True), (0.0, False)):
        energy = EnergyGuard(
            tmp_path, 1000.0, viscosity, Budget(1e-2), work_rate=lambda path, density: 0.0
        )
        guard = Guard(20.0, energy)
        cause = guard.check_energy(ended=True)
        assert (
            "does not close: the water has 0.0005 J of kinetic energy and has dissipated 0.6 J"
            in str(cause)
        ) == stops
        assert (guard.remedy == HALVE) == stops


def test_the_watchdog_acts_once_when_nothing_is_written():
    heard = []
    with Watchdog(0.2, lambda: heard.append(1)) as dog:
        for _ in range(6):
            time.sleep(0.02)
            dog.reset()
        assert dog.cause is None
        deadline = time.monotonic() + 20
        while dog.cause is None and time.monotonic() < deadline:
            time.sleep(0.05)
    assert heard == [1]


@pytest.mark.parametrize(
    "more, words",
    [
        ("[fluid]\nkinematic_viscosity = 1.004", ["fluid.kinematic_viscosity", "mm²/s", "0.01"]),
        ("[fluid]\nkinematic_viscosity = 1e-12", ["fluid.kinematic_viscosity", "1e-07"]),
        ("[fluid]\ndensity = 0.998", ["fluid.density", "g/cm³", "100"]),
        ("[levels.tiny.mesh]\nwall_cell = 0.02", ["mesh.wall_cell", "third", "at most 0.00483"]),
        ("[levels.tiny.mesh]\nfar_cell = 0.2", ["mesh.far_cell", "0.075"]),
        ("[levels.tiny.mesh]\nwall_first_layer = 0.004", ["mesh.wall_first_layer", "0.0035"]),
        ("[levels.tiny.mesh]\nnear_cell = 1e-7", ["mesh.near_cell", "thousandth"]),
        (
            "[levels.tiny.numerics]\ntime_step = 1e-7",
            ["numerics.time_step", "4.2e+06 steps", "4.2e-06"],
        ),
        ("[sheet]\nspacing = 1e-6", ["sheet.spacing", "points"]),
        ("[sheet]\nspacing = 0.5", ["sheet.spacing", "at most 0.02"]),
    ],
)
def test_numbers_that_no_tank_has_are_refused_with_the_nearest_that_works(tmp_path, more, words):
    folder, (section, line) = tmp_path / "s", more.split("\n")
    inside = section.startswith("[levels")  # a key of the level's own table
    if inside:
        write_scene(folder)
        table, key = section.removeprefix("[levels.tiny.").removesuffix("]"), line.split(" = ")[0]
        lines = (folder / "scene.toml").read_text().splitlines()
        lines = [
            re.sub(rf"\b{key} = [^,}}]+", line + " ", old) if old.startswith(table) else old
            for old in lines
        ]
        (folder / "scene.toml").write_text("\n".join(lines) + "\n")
    with pytest.raises(StageError) as caught:
        load_scene(folder, "tiny") if inside else write_scene(folder, more=more)
    for word in words:
        assert word in str(caught.value)


def test_the_courant_number_is_foreseen_from_the_walls_speed():
    """A wall of 1 mm edges at 0.3 m/s and 1 ms: 0.3 along its cells, four times that in the flow round it."""
    outline = np.column_stack([np.linspace(0, 0.02, 21), np.zeros(21)])
    outline = np.vstack([outline, outline[::-1] + np.array([0, 0.01])])
    positions = outline[None] + np.stack([np.zeros(5), 0.3e-3 * np.arange(5)], -1)[:, None]
    assert check_courant(positions, 1e-3 * np.arange(5), 20.0) == pytest.approx(1.2)
    with pytest.raises(
        ValueError, match=r"time_step of at most 0\.00025 s .now 0\.001 s."
    ) as caught:
        check_courant(positions, 1e-3 * np.arange(5), 0.3)
    assert "0.3 m/s along cells of 0.001 m" in str(caught.value)


@settings(deadline=None)  # of the machine, not of the code
@given(st.floats(1e-4, 10.0), st.floats(0.1, 100.0))
def test_what_the_refusal_offers_is_not_refused(scale, limit):
    positions = scale * (square()[None] + np.stack([0.3 * np.arange(5), np.zeros(5)], -1)[:, None])
    try:
        check_courant(positions, 1e-3 * np.arange(5), limit)
    except ValueError as error:
        offered = float(str(error).split("at most ")[1].split(" s")[0])
        part = offered / 1e-3
        slower = positions[:1] + part * (positions - positions[:1])
        check_courant(slower, offered * np.arange(5), limit)


def test_the_estimate_of_the_cells_is_of_the_right_size(tmp_path):
    """Measured: 1178 (tiny, 2-D); 3054 (smoke) and 63 thousand (coarse) of the shipped scene."""
    assert 1178 / 3 < estimated_cells(write_scene(tmp_path / "s")) < 3 * 1178
    shipped = ROOT / "cases" / "single_finger"
    assert 3054 / 3 < estimated_cells(load_scene(shipped, "smoke")) < 3 * 3054
    assert 6.3e4 / 3 < estimated_cells(load_scene(shipped, "coarse")) < 3 * 6.3e4


def test_a_time_step_that_does_not_end_stops_the_run():
    """Lines come for ever, as with a billion outer correctors: silence alone is no measure."""
    watchdog = Watchdog(900.0, lambda: None)
    for _ in range(10):
        assert watchdog.check(2.0) is None
        watchdog.reset()
        watchdog.advance()
    for _ in range(50):  # steps of 2 s: 100 s are 50 times the median
        watchdog.reset()
        assert watchdog.check(2.0) is None
    watchdog.reset()
    assert (
        watchdog.check(2.0)
        == "a time step has taken 102 s and has not ended, longer than 50 others"
    )


def test_a_step_of_less_than_a_minute_is_never_too_long():
    watchdog = Watchdog(900.0, lambda: None)
    for _ in range(2):
        watchdog.advance()  # start-up and a step in no time
    assert watchdog.check(59.0) is None
    assert watchdog.check(2.0) is not None


def test_the_first_step_has_an_hour():
    """However short the start-up was."""
    watchdog = Watchdog(1e9, lambda: None)
    assert watchdog.check(2.0) is None
    watchdog.advance()
    assert watchdog.check(3599.0) is None
    assert watchdog.check(2.0) == "the solver's first time step has not ended after 3601 s"


@pytest.mark.parametrize(
    "code, tail, name",
    [
        (-9, "", "SIGKILL"),
        (-15, "", "SIGTERM"),
        (137, "mpirun noticed that process rank 1 exited on signal 9 (Killed).", "SIGKILL"),
        (1, "FOAM FATAL ERROR", None),
        (134, "", None),
    ],
)
def test_a_killed_solver_is_told_with_its_signal(tmp_path, code, tail, name):
    (tmp_path / LOG).write_text(tail)
    said = str(failed(tmp_path, Guard(20.0), code))
    if name:
        assert f"pimpleFoam was killed at 0 s by {name}" in said
        assert "run make again" in said
    else:
        assert "its last lines" in said
