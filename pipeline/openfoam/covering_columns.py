"""Few cells that touch every node of a swept mesh: enough for OpenFOAM's layered motion."""

import numpy as np
from numpy import ndarray


def covering_columns(corners: ndarray, columns: ndarray) -> ndarray:
    """Some of `columns` (indices into `corners`) that touch every node which all of them touch.

    `corners` (column, 4): node numbers, a triangle's last one twice. Greedy: first columns of
    untouched nodes only, then those with fewer; a fifth of a planform's columns is left.
    """
    new = np.ones(int(corners.max()) + 1, bool)
    chosen = []
    for least in (4, 3, 2, 1):
        for column in columns:
            nodes = list(set(corners[column].tolist()))
            if new[nodes].sum() >= least:
                chosen.append(column)
                new[nodes] = False
    return np.sort(np.array(chosen, dtype=int))


def covering_cells(corners: ndarray, column: ndarray, layer: ndarray) -> ndarray:
    """Cells that touch every upright edge of a mesh; `column`, `layer` (cell,): of each cell."""
    chosen = np.zeros(len(column), bool)
    known: dict[bytes, ndarray] = {}  # layers beside and beyond the finger have equal columns
    for number in np.unique(layer):
        here = np.flatnonzero(layer == number)
        columns = np.sort(column[here])
        key = columns.tobytes()
        if key not in known:
            known[key] = covering_columns(corners, columns)
        chosen[here] = np.isin(column[here], known[key])
    return np.flatnonzero(chosen)
