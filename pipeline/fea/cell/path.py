"""The pressure path of a unit cell, out from rest in steps that Newton's method can take."""

from collections.abc import Callable, Iterable

from pipeline.fea.cell.unit_cell import NotConverged, State, UnitCell

LEAST_STEP = 10.0  # Pa
LARGEST_STEP = 2e3  # Pa


def follow(
    cell: UnitCell, pressures: Iterable[float], done: Callable[[], object] = lambda: None
) -> dict[float, State]:
    """States at `pressures` (Pa), by pressure; `done` is called after each.

    A branch ends where even `LEAST_STEP` fails: its further pressures are absent.
    """
    states: dict[float, State] = {}
    wanted = sorted(set(pressures))
    for branch in ([p for p in wanted if p >= 0], [p for p in reversed(wanted) if p < 0]):
        state, before = cell.rest(), None
        for target in branch:
            try:
                state, before = _reach(cell, state, before, target)
            except NotConverged:
                break
            states[target] = state
            done()
    return dict(sorted(states.items()))


def _reach(
    cell: UnitCell, state: State, before: State | None, target: float
) -> tuple[State, State | None]:
    step = LARGEST_STEP
    if target == state.pressure:
        return cell.solve(state, target), None
    while state.pressure != target:
        remaining = target - state.pressure
        pressure = target
        if abs(remaining) > step:
            pressure = state.pressure + (step if remaining > 0 else -step)
        try:
            solved = cell.solve(_extrapolated(state, before, pressure), pressure)
        except NotConverged:
            step = min(step, abs(remaining)) / 2
            before = None
            if step < LEAST_STEP:
                raise
            continue
        state, before = solved, state
    return state, before


def _extrapolated(state: State, before: State | None, pressure: float) -> State:
    """Straight on from the last two states, which saves about one iteration."""
    if before is None or state.pressure == before.pressure:
        return state
    ahead = (pressure - state.pressure) / (state.pressure - before.pressure)
    return State(pressure, state.unknowns + ahead * (state.unknowns - before.unknowns))
