"""The forces of the water that moves with the finger: potential flow on the mesh of the run.

A wall's acceleration makes the pressure p with Δp = 0 and dp/dn = -ρ a_n at once, whatever the flow
is. Discretised as the solver does it, on its own cells, this is how its next pressure will answer
an acceleration of the wall; p = 0 at the gaps by the water surface.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
import xarray as xr
from numpy.typing import NDArray
from scipy.sparse.linalg import LinearOperator, cg

from pipeline.formats.bending_states import FloatArray
from pipeline.geometry.quality import cell_areas, cell_centres, planform_edges

# of the sources: 1 % of the inertia, of which a third may be wrong (test_coupling.py)
_ACCURATE = 3e-2


def forces_of_water(
    planform: xr.Dataset,
    sweep: xr.Dataset,
    nodes: FloatArray,
    acceleration: FloatArray,
    gaps: NDArray[np.bool_],
    density: float,
    copies: float,
    accurate: float = _ACCURATE,
) -> tuple[FloatArray, FloatArray]:
    """Places (piece, 2) m of the finger's wall, and forces (mode, piece, 2) N on a whole finger.

    `nodes` (node, 2) m: of the planform in this shape; `acceleration` (mode, node, 2) m/s² of its
    nodes on the wall; `gaps` (edge,): those of the tank's sides that are open; `copies`: of the
    computed part in a whole finger; `accurate`: share of the sources that may be left.
    """
    triangles, quads = planform["triangles"].values, planform["quads"].values
    column, layer = sweep["cell_column"].values, sweep["cell_layer"].values
    depth = np.diff(planform["levels"].values)
    centre = cell_centres(nodes, triangles, quads)
    number = np.full((len(centre), len(depth)), -1)
    number[column, layer] = np.arange(len(column))
    edges = planform_edges(triangles, quads)
    ends = nodes[edges.nodes]
    side = ends[:, 1] - ends[:, 0]
    area, middle = np.column_stack([side[:, 1], -side[:, 0]]), ends.mean(1)
    inner = edges.right >= 0

    span = np.where(inner[:, None], centre[edges.right], middle) - centre[edges.left]
    across = ((area**2).sum(1) / (span * area).sum(1))[:, None] * depth
    up = cell_areas(nodes, triangles, quads)[:, None] / (0.5 * (depth[1:] + depth[:-1]))
    own, other = number[edges.left], number[edges.right]
    lower, upper = number[:, :-1], number[:, 1:]
    beside = (own >= 0) & (other >= 0) & inner[:, None]
    above = (lower >= 0) & (upper >= 0)
    i = np.concatenate([own[beside], lower[above]])
    j = np.concatenate([other[beside], upper[above]])
    w = np.concatenate([across[beside], up[above]])
    cells = len(column)
    outside = gaps[:, None] & (own >= 0)
    open_ = np.bincount(own[outside], across[outside], cells)
    diagonal = np.asarray(np.bincount(i, w, cells) + np.bincount(j, w, cells) + open_, float)
    off = sp.coo_array((-w, (i, j)), shape=(cells, cells))
    matrix = (sp.diags_array(diagonal) + off + off.T).tocsr()

    body = np.concatenate([planform["body"].values, np.zeros(len(quads), int)])
    finger = inner & ((body[edges.left] == 1) ^ (body[np.where(inner, edges.right, 0)] == 1))
    on_right = body[edges.left] == 1  # the water
    outwards = np.where(on_right, 1.0, -1.0)[finger, None] * area[finger]  # out of the water
    wet, dry = (np.where(on_right[:, None], *two)[finger] for two in ((other, own), (own, other)))
    blocked = (wet >= 0) & (dry < 0)
    piece, level = np.nonzero(blocked)
    of_edges = acceleration[:, edges.nodes[finger]].mean(2)
    through = np.einsum("mpi,pi->pm", of_edges, outwards)
    moved = np.zeros((cells, len(acceleration)))
    np.add.at(moved, wet[blocked], through[piece] * depth[level, None])
    pressure = -density * _solved(matrix, diagonal, moved, accurate)
    total = np.zeros((int(finger.sum()), len(acceleration)))
    np.add.at(total, piece, pressure[wet[blocked]] * depth[level, None])
    return middle[finger], copies * total.T[:, :, None] * outwards


def _solved(
    matrix: sp.csr_array, diagonal: FloatArray, right: FloatArray, accurate: float
) -> FloatArray:
    """Columns x of matrix x = right, by conjugate gradients.

    The level of the pressure, which the gaps alone hold, converges by a term of its own. In single
    precision, whose dot products start no threads.
    """
    single, share = matrix.astype(np.float32), (1 / diagonal).astype(np.float32)
    open_ = float(matrix.sum())  # one of NumPy would make it all double
    preconditioner = LinearOperator(
        matrix.shape, lambda rest: share * rest + rest.sum() / open_, dtype=np.float32
    )
    columns = right.T.astype(np.float32)
    return np.column_stack(
        [cg(single, column, rtol=accurate, M=preconditioner)[0] for column in columns]
    )
