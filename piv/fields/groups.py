"""Groups of instants: by phase of a period, between triggers, or by a quantity's value."""

import numpy as np
from numpy import ndarray


def phases(times: ndarray, period: float, start: float = 0.0) -> ndarray:
    """Phase (0 to 1) of each instant from the period, both in the unit of `times`."""
    if not (np.isfinite(period) and period > 0):
        raise ValueError(f"the period must be positive, got {period}")
    turns = (np.asarray(times, float) - start) / period
    return (
        turns + 1e-9
    ) % 1.0  # an instant at the very end of a period, but for rounding, begins the next


def trigger_phases(times: ndarray, triggers: ndarray) -> ndarray:
    """Phase (0 to 1) of each instant between its triggers; NaN before the first, after the last."""
    triggers = np.sort(np.asarray(triggers, float))
    if triggers.size < 2 or not (np.diff(triggers) > 0).all():
        raise ValueError("at least two triggers at different times are needed")
    turns = np.interp(times, triggers, np.arange(triggers.size), left=np.nan, right=np.nan)
    turns[np.asarray(times) >= triggers[-1]] = np.nan
    return (turns + 1e-9) % 1.0


def bins(values: ndarray, edges: ndarray) -> tuple[ndarray, ndarray]:
    """Bin number of each value (-1: none) and the bins' centres; the last edge is inside."""
    edges = np.asarray(edges, float)
    if edges.size < 2 or not (np.diff(edges) > 0).all():
        raise ValueError("bins need at least two ascending edges")
    values = np.asarray(values, float)
    number = np.searchsorted(edges, values, side="right") - 1
    number[values == edges[-1]] = edges.size - 2
    number[~((values >= edges[0]) & (values <= edges[-1]))] = -1
    return number, 0.5 * (edges[:-1] + edges[1:])


def at_instants(times: ndarray, table_times: ndarray, values: ndarray) -> ndarray:
    """A quantity at the instants, linear between the table's ascending times; NaN outside."""
    if not (np.diff(table_times) > 0).all():
        raise ValueError("the times of the table must ascend")
    return np.interp(times, table_times, values, left=np.nan, right=np.nan)
