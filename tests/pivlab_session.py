"""Sessions of PIVlab as it writes them: MAT 5 by SciPy, MAT 7.3 as HDF5."""

from pathlib import Path

import h5py
import numpy as np
from scipy.io import savemat

X, Y = np.meshgrid([8.0, 16.0, 24.0], [8.0, 16.0])
KIND = np.array([[1.0, 1.0, 2.0], [0.0, 1.0, 1.0]])  # 0: masked, 2: replaced
FRAME = {"x": X, "y": Y, "u_original": 0.1 * X, "v_original": 0.2 * Y, "typevector_original": KIND}
UNITS = "[px] respectively [px/frame]"


def write_mat5(path: Path, frames: int = 1, compress: bool = False) -> Path:
    """A cell for each frame; u of frame k is k + 1 times that of the first."""
    cells = {name: np.empty((frames, 1), object) for name in (*FRAME, "u_filtered")}
    for k in range(frames):
        for name, cell in cells.items():
            cell[k, 0] = FRAME.get(name, np.empty((0, 0)))  # [] where nothing was filtered
        cells["u_original"][k, 0] = (k + 1) * FRAME["u_original"]
    other = {"settings": {"window": 32.0}, "empty": "", "units": UNITS}
    savemat(path, other | cells, do_compression=compress)
    return path


def write_session(path: Path, **more: float) -> Path:
    """A saved session, in px, of three pairs: the second was not correlated, the third filtered."""
    cells = np.empty((11, 3), object)
    cells.fill(np.empty((0, 0)))
    for k in (0, 2):
        cells[:5, k] = list(FRAME.values())
    cells[6:9, 2] = [2 * FRAME["u_original"], FRAME["v_original"], KIND]
    savemat(path, {"resultslist": cells, "PIVver": "3.00", **more})
    return path


def write_mat73(path: Path) -> Path:
    """One frame, by references."""
    with h5py.File(path, "w") as file:
        for name, values in FRAME.items():
            file[f"#refs#/{name}"] = values.T
            file.create_dataset(name, (1, 1), h5py.ref_dtype)[0, 0] = file[f"#refs#/{name}"].ref
        file["units"] = np.array([[ord(c)] for c in UNITS], np.uint16)
    return path
