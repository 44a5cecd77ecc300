"""Guards stop a run that goes wrong and no other."""

import time
from types import SimpleNamespace

import numpy as np
import pytest
import xarray as xr
from hypothesis import given
from hypothesis import strategies as st
from scipy.interpolate import PPoly

from pipeline.formats.records import LOSSES
from pipeline.openfoam.displacement_files import Steps
from pipeline.scene.predicted import estimated_cells
from pipeline.scene.scene import load_scene
from pipeline.solve.guards import (
    ENERGY_TOLERANCE,
    HALVE,
    Budget,
    EnergyGuard,
    Guard,
    check_courant,
    energy_budget,
    energy_from_nothing,
    force_change,
    guard_of,
    power_warning,
    step_warning,
)
from pipeline.solve.power import power_balance
from pipeline.solve.solver import LOG, Watchdog, failed
from piv.files.errors import StageError
from tests.conftest import CASES, write_scene

STEP = (
    "Courant Number mean: 0.1 max: {courant}\nTime = {time}\n\nsmoothSolver:  Solving for Ux,"
    " Initial residual = {residual}, Final residual = 1e-9, No Iterations 2\nGAMG:  Solving for p,"
    " Initial residual = 0.8, Final residual = 0.01, No Iterations {iterations}\n"
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
def test_the_log_of_a_bad_step_gives_one_cause(changes, words):
    guard = Guard(20.0)
    assert verdicts(guard) == []
    assert guard.time == 0.1
    (cause,) = verdicts(guard, **changes)
    assert words in cause


def test_a_missing_function_object_of_openfoam_stops_the_run():
    """OpenFOAM only warns; the forces would be missing at the end."""
    guard = Guard(10)
    assert guard.time == 0.0  # for the message: before the first step
    cause = guard.verdict("Unknown function type forces\n")
    assert cause == "OpenFOAM has no function object forces"
    assert "install the whole" in guard.remedy


def test_a_pressure_that_never_converges_stops_the_run_after_some_steps():
    guard = Guard(20.0)
    causes = [verdicts(guard, iterations=1000) for _ in range(7)]
    assert causes[:5] == [[]] * 5
    assert "did not converge in 5 steps" in causes[5][0]


def feed(budget, times, power, kinetic, dissipation=None):
    """Index of the first sample at which there is energy from nothing, or None."""
    lost = np.zeros(len(times)) if dissipation is None else dissipation
    samples = zip(times, power, kinetic, lost, strict=True)
    return next((k for k, s in enumerate(samples) if budget.add(*s) is not None), None)


def stroke(loss=0.3, n=200):
    """Power of a stroke, and the kinetic energy where a part of its work is lost."""
    times = np.arange(1, n + 1) / n
    power = np.sin(np.pi * times) ** 2 - 0.2 * np.sin(2 * np.pi * times) ** 2
    return times, power, (1 - loss) * np.cumsum(power) / n


@pytest.mark.parametrize("loss", [0.0, 0.3, 0.9])
def test_energy_from_work_passes_for_every_loss(loss):
    assert feed(Budget(1e-6), *stroke(loss)) is None


@pytest.mark.parametrize("jump", [0.1, 1.0])
def test_energy_from_nothing_is_found_below_the_total_work(jump):
    """Dissipation hides it in the total: after a loss of 60 % the energy must not rise again."""
    times, power, kinetic = stroke(0.6)
    excess = jump * kinetic[149]
    kinetic[150:] += jump * kinetic[150]
    found = excess > 1.1 * ENERGY_TOLERANCE * np.cumsum(power)[150] / 200
    assert feed(Budget(1e-6), times, power, kinetic) == (150 if found else None)


def test_a_flow_before_the_finger_moves_is_found():
    """A mesh that jumps in its first step: a flow everywhere without work."""
    times, power, kinetic = stroke()
    assert feed(Budget(1e-3), times, power, kinetic + 0.05) == 0


def test_growth_without_motion_and_invalid_numbers_are_found():
    budget = Budget(1e-6)
    assert budget.add(0.1, 1.0, 0.05, 0.0) is None
    grown = [budget.add(0.1 + 0.01 * k, 0.0, 0.05 * 1.02**k, 0.0) for k in range(1, 20)]
    assert any(g is not None for g in grown)
    for sample in ((np.nan, 1.0, 0.0), (1.0, np.nan, 0.0), (1.0, np.inf, 0.0), (1.0, 1.0, np.inf)):
        assert Budget(1.0).add(0.1, *sample) == np.inf


def test_dissipation_without_work_is_found_and_a_stroke_in_a_thick_fluid_passes():
    """The end of a real run that closed to -46 % (docs/stability.md, corner 2 ms, 1e-3 m²/s).

    The wall's power alternates, its work is dissipated at once, and the kinetic energy looks sound.
    """
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
    most = np.maximum(0.85 * power, 0.0)  # of the 90 % that are lost
    assert feed(Budget(1e-6), times, power, kinetic, most) is None


def square(size=0.02):
    return size * np.array([[0.0, 0], [1, 0], [1, 1], [0, 1]])


@pytest.mark.parametrize("sudden", [False, True])
def test_an_impulsive_start_of_the_wall_is_allowed(sudden):
    steps = np.arange(41) * 1e-3
    path = 0.3 * steps if sudden else 0.3 * steps**3 / steps[-1] ** 2
    positions = square()[None] + np.stack([path, 0 * steps], -1)[:, None]
    budget = energy_budget(positions, steps, 0.03, 1000.0)
    energy = 0.5 * 1000 * 0.3**2 * 0.02**2 * 0.03
    assert (budget.add(2e-3, 0.0, energy, 0.0) is None) == sudden
    assert budget.add(20e-3, 0.0, 2 * energy, 0.0) is not None  # no jump of the wall


@pytest.mark.parametrize("part, jumps", [(0.15, False), (0.25, True)])
def test_a_wall_whose_speed_changes_by_a_fifth_of_its_peak_in_a_step_jumps(part, jumps):
    """A jump of less than that does little work that no sample sees; the guard must not forgive it.

    The energy from nothing after it is then found, too.
    """
    times = np.arange(41) * 1e-3
    speed = np.minimum(np.arange(40) / 20, 1.0) * 0.3  # grows by a twentieth of its peak in a step
    speed[30:] -= part * 0.3
    path = np.concatenate([[0.0], np.cumsum(speed) * 1e-3])
    positions = square()[None] + np.stack([path, 0 * path], -1)[:, None]
    budget = energy_budget(positions, times, 0.03, 1000.0)
    assert budget.unresolved(29e-3, 31e-3) is jumps
    assert not budget.unresolved(2e-3, 28e-3)
    energy = 0.5 * 1000 * 0.3**2 * 0.02**2 * 0.03
    budget.begin(29e-3, 0.0, energy, 0.0)
    assert (budget.add(31e-3, 0.0, 1.2 * energy, 0.0) is None) == jumps


@pytest.mark.parametrize("steps, warned", [(40, ""), (12, "may be 54 % wrong"), (2, "100 % wrong")])
def test_a_time_step_that_does_not_resolve_the_force_is_warned_of(steps, warned):
    """An oscillation of so many steps; with 40 its phase over a step is 0.16 rad."""
    phase = 2 * np.pi * np.arange(50 * steps) / steps
    force = np.column_stack([np.cos(phase), 0.2 * np.cos(phase)])
    # chord over arc, and the ends
    assert force_change(force) == pytest.approx(2 * np.sin(np.pi / steps), rel=0.01)
    warning = step_warning(force, 0.01)
    assert warned in warning
    assert bool(warning) == bool(warned)
    assert step_warning(0 * force, 0.01) == ""  # a finger at rest


def test_unexplained_power_is_warned_of_and_then_refused():
    """Of an impulsive start the work is not sampled: it is warned of, and goes on."""
    steps = np.arange(41) * 1e-3
    smooth, sudden = (
        energy_budget(square()[None] + np.stack([way, 0 * steps], -1)[:, None], steps, 0.03, 1000.0)
        for way in (0.3 * steps**3 / steps[-1] ** 2, 0.3 * steps)
    )
    assert power_warning(0.05, [smooth], 1e-3) == ""
    assert "6 % of the power" in power_warning(0.06, [smooth], 1e-3)
    assert "lower numerics.time_step = 0.01" in power_warning(0.4, [smooth, sudden], 0.01)
    with pytest.raises(StageError, match="16 % of the power that"):
        power_warning(0.16, [smooth], 1e-3)


def test_the_share_of_unexplained_power_is_of_what_is_exchanged():
    """A body that swings gives and takes: its net work is near zero, its share is not infinite."""
    time = np.linspace(0.01, 1.0, 100)
    power = np.sin(2 * np.pi * time)  # W; it exchanges 2/pi J in a period, and no net work
    table = np.column_stack([time, power, np.full(100, 0.01), 0 * time])
    terms = np.column_stack([time, np.zeros((100, len(LOSSES)))])
    balance = power_balance(table, terms)
    assert balance["unexplained_share"] == pytest.approx(0.01 * np.pi / 2, rel=1e-2)  # trapezia
    assert abs(balance["unexplained_fraction"]) > 1  # of the net work


def test_viscosity_is_known_between_rare_fields():
    """The fields of a body that swings are written once in a period, always at its turn."""
    time = np.linspace(0.01, 3.0, 300)
    power = np.sin(2 * np.pi * time) ** 2  # W; all of it goes into viscosity
    table = np.column_stack([time, power, 0 * time, power])
    terms = np.column_stack([[1.0, 2.0, 3.0], np.zeros((3, len(LOSSES)))])
    balance = power_balance(table, terms)
    assert balance["taken"]["viscous"] == pytest.approx(1.5, rel=1e-3)  # trapezia
    assert balance["unexplained_share"] < 1e-9  # rounding


def test_the_energy_of_a_whole_run_forgives_what_one_interval_forgives():
    """Two computed parts; the wall of the second interval jumps at 1.5 s, its floor is 0.1 J."""
    budgets = [Budget(0.0), Budget(0.1, lambda a, b: a < 1.5 < b)]
    power = np.array([[1, 1, 1, 0], [2, 0, 3, 0], [3, 0, 3.3, 0], [4, 0, 4, 0]])
    # of 1 J by the jump nothing counts; 0.3 J are less than 5 % of 3.3 J and both floors
    assert energy_from_nothing(power[:3], budgets, 2) == pytest.approx(0.3 / 3.3)
    with pytest.raises(StageError, match=r"stopped at 4 s by a guard: .* 1 J more"):
        energy_from_nothing(power, budgets, 2)
    assert energy_from_nothing(0 * power, budgets, 2) == 0.0


def test_an_intervals_guard_knows_its_wall_within_the_interval_alone(tmp_path):
    """From 0 s a square moves at 0.3 m/s. Its shapes before and after the interval are wild."""

    def pressure(times):
        return np.where(times < 0, 5.0, np.where(times > 0.0401, times * 1e3, 0.3 * times))

    moved = np.repeat([[[1.0, 0.0]]], 4, axis=1)  # m of each node by the pressure
    shape = PPoly(np.stack([moved, square()[None]]), [0.0, 1.0])
    motion = SimpleNamespace(shape=shape, pressure=pressure)
    mesh = SimpleNamespace(planform={"wall": xr.DataArray(np.arange(4))}, motion=motion)
    steps = Steps.of(-2e-3, 40e-3, 1e-3)
    fluid = load_scene(CASES / "single_finger", "smoke").fluid
    guard = guard_of(tmp_path, mesh, steps, 20.0, 0.03, fluid)
    energy = 0.5 * fluid.density * 0.3**2 * 0.02**2 * 0.03
    assert guard.energy.budget.floor == pytest.approx(1e-3 * energy)


def sampled(folder, rows, part="0"):
    """Tables and surfaces of samples as the solver writes them."""
    table = folder / "volumes" / part / "volFieldValue.dat"
    table.parent.mkdir(parents=True, exist_ok=True)
    table.write_text(rows)
    for row in rows.splitlines():
        surface = folder / "fingerSurface" / row.split()[0] / "finger.vtk"
        surface.parent.mkdir(parents=True, exist_ok=True)
        surface.touch()


def no_work(path, density):
    return 0.0


def test_samples_are_read_when_they_are_complete(tmp_path):
    seen = []

    def rate(path, density):
        seen.append(path.parent.name)
        return 1.0

    guard = EnergyGuard(tmp_path, 1000.0, 1e-6, Budget(1e-9), work_rate=rate)
    assert guard.check() is None
    sampled(tmp_path, "0.002\t1e-6 0 0\n0.004\t2e-6 0 0\n0.006\t1")
    assert guard.check() is None
    assert seen == ["0.002"]  # the second may still lack its surface
    sampled(tmp_path, "0.002\t1e-6 0 0\n0.004\t2e-6 0 0\n0.006\t1.0 0 0\n")
    assert guard.check() is None
    assert "500 J of kinetic energy" in guard.check(ended=True)
    assert seen == ["0.002", "0.004", "0.006"]


def test_a_resumed_run_begins_with_the_energy_of_its_first_sample(tmp_path):
    sampled(tmp_path, "0.302 1.0 0 0\n0.304 0.99 0 0\n0.306 1.2 0 0\n", "0.3")
    guard = EnergyGuard(tmp_path, 2.0, 0.0, Budget(1e-9), from_rest=False, work_rate=no_work)
    assert "1.2 J of kinetic energy and has dissipated 0 J, 0.21 J more" in guard.check(ended=True)


def of_ends(folder, rows):
    """Tables of both ends, of which water enters at the first alone."""
    for end in ("upstream", "downstream"):
        table = folder / f"{end}Carried" / "0" / "surfaceFieldValue.dat"
        table.parent.mkdir(parents=True, exist_ok=True)
        lines = rows if end == "upstream" else [f"{row.split()[0]} 0 0 (0 0 0)" for row in rows]
        table.write_text("".join(f"{line}\n" for line in lines))


@pytest.mark.parametrize("carried", ["-1 0", "0 -2", "-0.5 -1"])
def test_a_current_brings_the_energy_that_the_finger_does_not(tmp_path, carried):
    """2 kg/m³: p and half of |u|² over 1 m³/s that enters bring 2 W, 0.2 J in each 0.1 s."""
    sampled(tmp_path, "0.1 1.0 0 0\n0.2 1.2 0 0\n0.3 1.4 0 0\n")
    rows = [f"{time} {carried} (0 0 0)" for time in (0.1, 0.2, 0.3)]
    of_ends(tmp_path, rows)

    def guard(current):
        budget = Budget(1e-9)
        return EnergyGuard(tmp_path, 2.0, 0.0, budget, False, no_work, current=current)

    assert guard(True).check(ended=True) is None
    assert "0.2 J more" in guard(False).check(ended=True)
    of_ends(tmp_path, rows[:2])  # the last sample waits for what the ends carried then
    early = guard(True)
    assert early.check() is None
    assert early.rows == 1


@pytest.mark.parametrize("viscosity, stops", [(1e-3, True), (0.0, False)])
def test_the_resolved_dissipation_needs_work(tmp_path, viscosity, stops):
    """1000 kg/m³, 1e-3 m²/s: the integrals 5 and 2 m³/s² are 6 W without work."""
    sampled(tmp_path, "0.1 1e-6 5 2\n0.2 1e-6 5 2\n")
    energy = EnergyGuard(tmp_path, 1000.0, viscosity, Budget(1e-2), work_rate=no_work)
    guard = Guard(20.0, energy)
    words = "does not close: the water has 0.0005 J of kinetic energy and has dissipated 0.6 J"
    assert (words in str(guard.check_energy(ended=True))) == stops
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


def test_the_courant_number_is_predicted_from_the_walls_speed():
    """A wall of 1 mm edges, 0.3 m/s, 1 ms: 0.3 along its cells, four times that in the flow."""
    outline = np.column_stack([np.linspace(0, 0.02, 21), np.zeros(21)])
    outline = np.vstack([outline, outline[::-1] + np.array([0, 0.01])])
    positions = outline[None] + np.stack([np.zeros(5), 0.3e-3 * np.arange(5)], -1)[:, None]
    times, offer = 1e-3 * np.arange(5), r"time_step of at most 0\.00025 s .now 0\.001 s."
    assert check_courant(positions, times, 20.0) == pytest.approx(1.2)
    with pytest.raises(ValueError, match=offer) as caught:
        check_courant(positions, times, 0.3)
    assert "0.3 m/s along cells of 0.001 m" in str(caught.value)


@given(st.floats(1e-4, 10.0), st.floats(0.1, 100.0))
def test_the_time_step_that_a_refusal_offers_is_accepted(scale, limit):
    positions = scale * (square()[None] + np.stack([0.3 * np.arange(5), np.zeros(5)], -1)[:, None])
    try:
        check_courant(positions, 1e-3 * np.arange(5), limit)
    except ValueError as error:
        offered = float(str(error).split("at most ")[1].split(" s")[0])
        slower = positions[:1] + offered / 1e-3 * (positions - positions[:1])
        check_courant(slower, offered * np.arange(5), limit)


def test_the_estimate_of_the_cells_is_of_the_right_size(tmp_path):
    """Measured: 1178 (tiny, 2-D); 3054 (smoke) and 63 thousand (coarse) of the shipped scene."""
    shipped = CASES / "single_finger"
    scenes = write_scene(tmp_path / "s"), *(load_scene(shipped, n) for n in ("smoke", "coarse"))
    for scene, cells in zip(scenes, (1178, 3054, 6.3e4), strict=True):
        assert cells / 3 < estimated_cells(scene) < 3 * cells


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
def test_the_error_of_a_killed_solver_names_its_signal(tmp_path, code, tail, name):
    (tmp_path / LOG).write_text(tail)
    error = str(failed(tmp_path, 0.0, code))
    words = [f"pimpleFoam was killed at 0 s by {name}", "run make again"]
    assert all(word in error for word in (words if name else ["its last lines"]))
