"""PIV, synthetic recordings and vortex identification; stands alone.

The names in `__all__` are the public interface. Each is imported on first use, so that `import piv`
is quick.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from piv.files import __version__

if TYPE_CHECKING:
    from piv.correlation.options import Options as Options
    from piv.correlation.pair import correlate_pair as correlate_pair
    from piv.fields.derived import derived as derived
    from piv.fields.lines import along_line as along_line
    from piv.fields.spectra import space_spectrum as space_spectrum
    from piv.fields.spectra import time_spectrum as time_spectrum
    from piv.fields.statistics import statistics as statistics
    from piv.foreign.read import open_vectors as open_vectors
    from piv.foreign.read import read_vectors as read_vectors
    from piv.foreign.write import write_vectors as write_vectors
    from piv.formats.plane_series import make_plane as make_plane
    from piv.formats.plane_series import read_plane as read_plane
    from piv.formats.plane_series import usable as usable
    from piv.formats.plane_series import write_plane as write_plane
    from piv.images.calibration import Calibration as Calibration
    from piv.images.calibration import calibrate_plane as calibrate_plane
    from piv.images.calibration import load_calibration as load_calibration
    from piv.images.open_recording import open_recording as open_recording
    from piv.images.part_of_recording import part_of_recording as part_of_recording
    from piv.momentum.outline import line_loads as line_loads
    from piv.momentum.pressure import pressure as pressure
    from piv.sequence.correlate import correlate as correlate
    from piv.sequence.ensemble import correlate_ensemble as correlate_ensemble
    from piv.sequence.frame_sets import SequenceOptions as SequenceOptions
    from piv.sequence.multiframe import correlate_frames as correlate_frames
    from piv.sequence.sequence import correlate_recording as correlate_recording
    from piv.vortices.find import find_vortices as find_vortices
    from piv.vortices.settings import VortexSettings as VortexSettings
    from piv.vortices.table import tabulate_vortices as tabulate_vortices

_MODULES = {
    "piv.formats.plane_series": ("make_plane", "read_plane", "usable", "write_plane"),
    "piv.correlation.options": ("Options",),
    "piv.correlation.pair": ("correlate_pair",),
    "piv.fields.derived": ("derived",),
    "piv.fields.lines": ("along_line",),
    "piv.fields.spectra": ("space_spectrum", "time_spectrum"),
    "piv.fields.statistics": ("statistics",),
    "piv.foreign.read": ("open_vectors", "read_vectors"),
    "piv.foreign.write": ("write_vectors",),
    "piv.images.calibration": ("Calibration", "calibrate_plane", "load_calibration"),
    "piv.images.open_recording": ("open_recording",),
    "piv.images.part_of_recording": ("part_of_recording",),
    "piv.momentum.outline": ("line_loads",),
    "piv.momentum.pressure": ("pressure",),
    "piv.sequence.correlate": ("correlate",),
    "piv.sequence.ensemble": ("correlate_ensemble",),
    "piv.sequence.multiframe": ("correlate_frames",),
    "piv.sequence.frame_sets": ("SequenceOptions",),
    "piv.sequence.sequence": ("correlate_recording",),
    "piv.vortices.find": ("find_vortices",),
    "piv.vortices.settings": ("VortexSettings",),
    "piv.vortices.table": ("tabulate_vortices",),
}
_HOME = {name: module for module, names in _MODULES.items() for name in names}
__all__ = ["__version__", *_HOME]


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'piv' has no attribute {name!r}")
    return getattr(import_module(_HOME[name]), name)
