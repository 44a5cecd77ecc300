"""PIV, synthetic recordings and vortex identification; stands alone.

The names in `__all__` are the public interface. Each is imported on first use, so that `import piv` is quick.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from fileio import __version__

if TYPE_CHECKING:
    from fileio.formats.plane_series import read_plane, write_plane
    from piv.correlation.options import Options
    from piv.correlation.pair import correlate_pair
    from piv.foreign.read import read_vectors
    from piv.foreign.write import write_vectors
    from piv.images.calibration import Calibration, calibrate_plane, load_calibration
    from piv.images.open_recording import open_recording
    from piv.sequence.ensemble import correlate_ensemble
    from piv.sequence.multiframe import correlate_frames
    from piv.sequence.sequence import SequenceOptions, correlate_recording
    from piv.vortices.find import find_vortices
    from piv.vortices.settings import VortexSettings
    from piv.vortices.table import tabulate_vortices

_MODULES = {
    "fileio.formats.plane_series": ("read_plane", "write_plane"),
    "piv.correlation.options": ("Options",),
    "piv.correlation.pair": ("correlate_pair",),
    "piv.foreign.read": ("read_vectors",),
    "piv.foreign.write": ("write_vectors",),
    "piv.images.calibration": ("Calibration", "calibrate_plane", "load_calibration"),
    "piv.images.open_recording": ("open_recording",),
    "piv.sequence.ensemble": ("correlate_ensemble",),
    "piv.sequence.multiframe": ("correlate_frames",),
    "piv.sequence.sequence": ("SequenceOptions", "correlate_recording"),
    "piv.vortices.find": ("find_vortices",),
    "piv.vortices.settings": ("VortexSettings",),
    "piv.vortices.table": ("tabulate_vortices",),
}
_HOME = {name: module for module, names in _MODULES.items() for name in names}

__all__ = [
    "Calibration",
    "Options",
    "SequenceOptions",
    "VortexSettings",
    "__version__",
    "calibrate_plane",
    "correlate_ensemble",
    "correlate_frames",
    "correlate_pair",
    "correlate_recording",
    "find_vortices",
    "load_calibration",
    "open_recording",
    "read_plane",
    "read_vectors",
    "tabulate_vortices",
    "write_plane",
    "write_vectors",
]


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'piv' has no attribute {name!r}")
    return getattr(import_module(_HOME[name]), name)
