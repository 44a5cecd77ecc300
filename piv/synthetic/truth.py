"""The exact truth of a synthetic recording, as a plane series written plane by plane."""

from collections.abc import Iterator
from pathlib import Path

import xarray as xr
from tqdm import tqdm

from piv.formats.plane_series import FINGER_VARIABLES, provenance
from piv.formats.plane_writer import instant, new_series, write_blocks
from piv.synthetic.virtual_camera import Recorder, finger_at


def write_truth(recorder: Recorder, path: Path, *, quiet: bool = True) -> None:
    """Write u, v, valid (time, y, x) at the middle of every frame interval, atomically.

    Values as `Recorder.truth` gives them; only one plane is in memory at once.
    """
    taken = recorder.taken
    first = taken[::2] if recorder.camera.pairs_every > 1 else taken[:-1]
    middle = (recorder.time[first] + recorder.time[first + 1]) / 2
    x, y = (axis[:: recorder.truth_stride] for axis in (recorder.field.x, recorder.field.y))
    series = recorder.series
    about = {k: series.attrs[k] for k in ("tip_width",) if k in series.attrs}
    about |= {"source": "truth", "seed": recorder.seed} | provenance(**recorder.attributes())
    names = [name for name in FINGER_VARIABLES if name in series]

    def parts() -> Iterator[xr.Dataset]:
        for k, time in zip(first, tqdm(middle, "truth", disable=quiet or None), strict=True):
            fields = dict(zip(("u", "v", "valid"), recorder.truth(int(k)), strict=True))
            yield instant(fields | {name: finger_at(series, name, time) for name in names})

    write_blocks(parts(), path, new_series(middle, x, y).assign_attrs(about))
