"""The exact truth of a synthetic recording, as a plane series written plane by plane."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from tqdm import tqdm

from fileio.formats.plane_series import FINGER_VARIABLES, FORMAT, FORMAT_VERSION, UNITS, provenance
from fileio.hdf5_disk import whole_hdf5
from piv.synthetic.virtual_camera import Recorder, finger_at


def write_truth(recorder: Recorder, path: Path, *, quiet: bool = True) -> None:
    """Write u, v, valid (time, y, x) at the middle of every interval of frames taken to `path`, whole or not at all.

    Values as `Recorder.truth` gives them; only one plane is in memory at once.
    """
    taken = recorder.taken
    first = taken[::2] if recorder.camera.pairs_every > 1 else taken[:-1]
    middle = (recorder.time[first] + recorder.time[first + 1]) / 2
    x, y = (axis[:: recorder.truth_stride] for axis in (recorder.field.x, recorder.field.y))
    with whole_hdf5(path) as file:
        for name, values in (("time", middle), ("y", y), ("x", x)):
            file.create_dataset(name, data=np.asarray(values, float)).make_scale(name)
            file[name].attrs["units"] = UNITS[name]
        size = (middle.size, y.size, x.size)
        for name, dtype in (("u", "f8"), ("v", "f8"), ("valid", "u1")):
            data = file.create_dataset(
                name, size, dtype, chunks=(1, *size[1:]), compression="gzip", compression_opts=1
            )
            data.attrs["units"] = UNITS[name]
            for k, dim in enumerate(("time", "y", "x")):
                data.dims[k].attach_scale(file[dim])
        for i in tqdm(range(middle.size), unit="plane", desc="truth", disable=quiet or None):
            file["u"][i], file["v"][i], file["valid"][i] = recorder.truth(int(first[i]))
        for name in FINGER_VARIABLES:
            if name in recorder.series:
                dims = recorder.series[name].dims
                values = np.array([finger_at(recorder.series, name, t) for t in middle])
                data = file.create_dataset(name, data=values)
                data.attrs["units"] = UNITS[name]
                for k, dim in enumerate(map(str, dims)):
                    if dim not in file:
                        file.create_dataset(dim, data=np.arange(values.shape[k])).make_scale(dim)
                    data.dims[k].attach_scale(file[dim])
        attrs = {"format": FORMAT, "format_version": FORMAT_VERSION, "source": "truth", "seed": recorder.seed}
        attrs |= {
            k: recorder.series.attrs[k] for k in ("scene_hash", "tip_width") if k in recorder.series.attrs
        }
        file.attrs.update(attrs | provenance(**recorder.attributes()))
