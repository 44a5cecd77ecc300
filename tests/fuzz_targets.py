"""Every reader of foreign files, with small valid files to start from.

A reader reads a damaged file or refuses it with one sentence; anything else is a fault.
"""

import warnings
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import xarray as xr

from pipeline.formats.bending_states import BendingStates, read_states, write
from pipeline.formats.kinematics import read_kinematics, write_kinematics
from pipeline.kinematics.pressure_law import measured_law
from pipeline.scene.scene import load_scene
from piv.files.errors import StageError
from piv.foreign.read import read_vectors
from piv.foreign.write import write_vectors
from piv.formats.plane_series import make_plane, read_checked_plane
from piv.formats.recording import RecordingWriter
from piv.images.calibration import load_calibration
from piv.images.masks import read_mask
from piv.images.open_recording import open_recording
from tests.camera_files import cine, imagej
from tests.conftest import CASES
from tests.pivlab_session import write_mat5, write_mat73, write_session

REFUSALS = (ValueError, OSError)  # a command of piv turns them into one sentence and exit code 2
STAGE = (StageError, OSError)  # so does the pipeline with these
SCENE = CASES / "single_finger" / "scene.toml"
LONGEST = 600  # characters of a sentence
ROWS, COLUMNS = 24, 32
PIXELS = {
    "length_unit": "px", "velocity_unit": "px/frame", "y_axis": "down", "scale_mm_per_px": 0.1,
    "interval": 0.002, "image_rows": 64,
}  # fmt: skip
METRES = {"length_unit": "m", "velocity_unit": "m/s", "y_axis": "up"}


class Fault(AssertionError):
    """A reader neither read nor refused."""


@dataclass(frozen=True)
class Target:
    """A reader: `read(path)` of a file `name`, and contents of valid files, `seeds(folder)`."""

    name: str
    read: Callable[[Path], Any]
    seeds: Callable[[Path], list[bytes]]
    refusals: tuple[type[Exception], ...] = REFUSALS
    beside: dict[str, bytes] = field(default_factory=dict)  # further files that the reader needs
    costs: int = 1  # divides the number of inputs


def check(target: Target, content: bytes, folder: Path) -> str | None:
    """None if the reader reads `content`, else its refusal; Fault if neither."""
    path = folder / target.name
    path.write_bytes(content)
    for name, more in target.beside.items():
        if not (folder / name).exists():
            (folder / name).write_bytes(more)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            target.read(path)
    except target.refusals as error:
        sentence = str(error.args[0] if isinstance(error, KeyError) and error.args else error)
        longest = LONGEST + 2 * len(str(folder))
        if "\n" in sentence or not sentence.strip() or len(sentence) > longest:
            raise Fault(f"{target.name}: no clear sentence: {sentence[:LONGEST]!r}") from error
        return sentence
    except Exception as error:
        raise Fault(f"{target.name}: {type(error).__name__}: {error}") from error
    return None


# --- images ---------------------------------------------------------------------------------------


def use_recording(path: Path) -> None:
    """Read the parts of a recording that the stages read."""
    with open_recording(path, colour="luma") as recording:
        for k in range(min(len(recording), 3)):
            assert recording.frame(k).shape == recording.shape
            mask = recording.mask(k)
            if mask is not None and mask.shape != recording.shape:
                raise Fault(f"{path.name}: a mask of {mask.shape} for frames of {recording.shape}")
        if recording.times is not None and len(recording.times) != len(recording):
            raise Fault(f"{path.name}: {len(recording.times)} times for {len(recording)} frames")


def use_mask(path: Path) -> None:
    """Read a mask, which must have the size asked for."""
    if read_mask(path, (ROWS, COLUMNS)).shape != (ROWS, COLUMNS):
        raise Fault(f"{path.name}: a mask of another size")


def picture(bits: int = 8) -> np.ndarray:
    """A small picture of noise."""
    top, kind = (256, np.uint8) if bits == 8 else (4096, np.uint16)
    return np.random.default_rng(bits).integers(0, top, (ROWS, COLUMNS)).astype(kind)


def encoded(suffix: str, _: Path) -> list[bytes]:
    """The picture as an image file: 8 bit, and 16 bit and colour where the format has them."""
    images = [picture()] if suffix in (".bmp", ".jpg") else [picture(), picture(16)]
    if suffix != ".pgm":
        images.append(np.dstack([picture()] * 2 + [picture() // 2]))
    return [bytes(cv2.imencode(suffix, image)[1]) for image in images]


def stack_seeds(folder: Path) -> list[bytes]:
    """TIFF stacks."""
    path = folder / "stack.tif"
    cv2.imwritemulti(str(path), [picture(), picture()[::-1]])
    return [path.read_bytes(), *encoded(".tif", folder)]


def imagej_seeds(folder: Path) -> list[bytes]:
    """A stack with one page for all pictures."""
    return [imagej(folder / "imagej.tif", np.stack([picture(16)] * 2)).read_bytes()]


def video_seeds(folder: Path) -> list[bytes]:
    """Videos in two codecs."""
    videos = []
    for code in ("FFV1", "MJPG"):
        path = folder / f"{code}.avi"
        out = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*code), 25, (COLUMNS, ROWS))
        for k in range(3):
            out.write(np.dstack([np.roll(picture(), k)] * 3))
        out.release()
        videos.append(path.read_bytes())
    return videos


CIH = """#Camera Information Header
Date : 2017/5/3
Camera Type : FASTCAM Mini UX100
Record Rate(fps) : 500
Shutter Speed(s) : 1/1000
Total Frame : 2
Original Total Frame : 2
Start Frame : 0
Image Width : 32
Image Height : 24
Color Type : Mono
Color Bit : {bits}
File Format : MRaw
EffectiveBit Depth : 12
EffectiveBit Side : Lower
Comment Text : none
END
"""


def recording_seeds(folder: Path) -> list[bytes]:
    """Recordings of this project, with and without masks."""
    recordings = []
    for masked in (False, True):
        path = folder / f"r{masked}.h5"
        attrs = {"frame_rate_hz": 500.0, "scale_mm_per_px": 0.1, "origin_x_px": 3.0, "bits": 8}
        with RecordingWriter(path, (ROWS, COLUMNS), np.uint8, 2, attrs, mask=masked) as writer:
            for k in range(2):
                writer.write(k, picture(), picture() > 200 if masked else None)
            writer.add("outline", ("time", "finger", "point", "axis"), np.zeros((2, 1, 4, 2)), "m")
            writer.finish()
        recordings.append(path.read_bytes())
    return recordings


POLYGONS = b"x,y\n2,2\n20,2\n20,12\n2,12\n", b"2 2\n20 2\n20 12\n", b"# body\n1,1\n5.5,1\n5,9\n"


# --- vectors --------------------------------------------------------------------------------------


def use_vectors(path: Path) -> None:
    """Read all vectors of a file."""
    of_davis = {k: PIXELS[k] for k in ("interval", "scale_mm_per_px", "image_rows")}
    own: dict[str, Any] = {".h5": {}, ".nc": {"y_axis": "up"}, ".dat": {"y_axis": "up"}, ".vec": {}}
    options = (own | {".vc7": of_davis}).get(path.suffix, PIXELS)
    options = {"vectors.txt": METRES, "davis.txt": {}}.get(path.name, options)
    with read_vectors([path], **options) as plane:
        use_plane(plane, path)


OPENPIV = b"# x y u v flags mask\n0 0 1 2 0 0\n1 0 1 2 1 0\n0 1 1 2 0 0\n1 1 nan 2 0 1\n"
SPOTS = b"0\t1\t1,5\t2\n1\t1\t1\t2\n0\t0\t0\t-0\n1\t0\t1\t2\n"
DAVIS = b'#DaVis 8.1.6 2D-vector 16 2 2 "position" "mm" "position" "mm" "velocity" "m/s"\n' + SPOTS
ZONE = b"0, 0, 1.5, 2, 1\n1, 0, 1, 2, 1\n0, 1, 1, 2, -1\n1, 1, 1, 2, 1\n"
TECPLOT = (
    b'TITLE="a"\nVARIABLES="X (mm)","Y (mm)","U (m/s)","V (m/s)","CHC"\n'
    b"ZONE I=2, J=2, F=POINT, SOLUTIONTIME=0.1\n" + ZONE
)
INSIGHT = (
    b'TITLE="a.vec" VARIABLES="X mm", "Y mm", "U m/s", "V m/s", "CHC", DATASETAUXDATA '
    b'Application="PIV" DATASETAUXDATA MicrosecondsPerDeltaT="2000.0" ZONE I=2, J=2, F=POINT\n'
    + ZONE
)


def cine_seeds(folder: Path) -> list[bytes]:
    """Films of a Phantom camera, 10 bit in 16 and packed."""
    frames = np.stack([picture(16) >> 2] * 2)
    kinds: list[dict[str, int]] = [{}, {"stored": 10, "compression": 256}]
    return [cine(folder / "a.cine", frames, **kind).read_bytes() for kind in kinds]


def use_plane(plane: xr.Dataset, path: Path) -> None:
    """Load a plane; vectors must be absent exactly where they are not valid."""
    plane.load()
    finite = np.isfinite(plane["u"].values) & np.isfinite(plane["v"].values)
    if (~finite & (plane["valid"].values != 0)).any():
        raise Fault(f"{path.name}: vectors are valid that are not numbers")


def written(suffix: str, folder: Path) -> list[bytes]:
    """A plane of 4 x 5 vectors with a hole, and a series of two, as this project writes them."""
    planes = []
    for series in (False, True) if suffix in (".h5", ".nc") else (False,):
        rng, shape = np.random.default_rng(1), (2, 4, 5) if series else (4, 5)
        u, v = rng.normal(size=(2, *shape))
        valid = rng.random(shape) > 0.2
        u, v = np.where(valid, u, np.nan), np.where(valid, v, np.nan)
        x, y, time = np.arange(5) * 1e-3, np.arange(4) * 1e-3, np.array([0.0, 0.002])
        path = folder / f"v{series}{suffix}"
        write_vectors(make_plane(x, y, u, v, valid=valid, time=time if series else None), path)
        planes.append(path.read_bytes())
    return planes


PIVLAB = (
    b"PIVlab, ASCII chart output\nFRAME: 1, filenames: A & B\n"
    b"x [px],y [px],u [px/frame],v [px/frame],Vector type [-]\n"
    b"8,8,0.8,1.6,1\n8,16,0.8,3.2,0\n16,8,1.6,1.6,1\n16,16,1.6,3.2,2\n"
)


def mat_seeds(folder: Path) -> list[bytes]:
    """PIVlab's .mat export, version 5 and 7.3, and a session."""
    path = folder / "a.mat"
    plain, packed = (write_mat5(path, compress=c).read_bytes() for c in (False, True))
    return [plain, packed, write_mat73(path).read_bytes(), write_session(path).read_bytes()]


def davis_seeds(folder: Path) -> list[bytes]:
    """A DaVis vector buffer, written by lvpyio (pip install lvpyio)."""
    import lvpyio as lv

    values = np.zeros((6, 8), dtype=lv.vec2c)
    values["u"], values["v"] = np.arange(8), np.arange(6)[:, None]
    buffer = lv.arrays_to_buffer([np.ma.array(values, mask=np.zeros((6, 8), bool))])
    buffer[0].grid = lv.Grid(16, 16, 1)
    lv.write_buffer(buffer, str(folder / "a.vc7"))
    return [(folder / "a.vc7").read_bytes()]


# --- inputs of the pipeline -----------------------------------------------------------------------


def use_states(path: Path) -> None:
    """Read states, which must be finite."""
    assert np.isfinite(read_states(path, 0.0145).profile).all()


def states_seeds(folder: Path) -> list[bytes]:
    """Four states, in a small file."""
    s = np.linspace(0, 0.07, 9)
    profile = np.stack([np.column_stack([s, k * s**2]) for k in (-1.0, 0.0, 1.0, 2.0)])
    states = BendingStates(
        np.array([-1e4, 0.0, 1e4, 2e4]), profile, np.full((4, 9), 0.0145), bend_angle=np.zeros(4),
        radius=np.array([-0.5, np.inf, 0.5, 0.25]), radius_std=np.array([0.01, np.inf, 0.01, 0.01]),
        fit_residual=np.zeros(4), converged=np.ones(4, np.uint8), width=0.028,
    )  # fmt: skip
    write(folder / "s.h5", states)
    return [(folder / "s.h5").read_bytes()]


def states_csv_seeds(_: Path) -> list[bytes]:
    """Digitised profiles."""
    rows = [f"{p},{s},{s},{p / 10 * s}" for p in (0, 10, 20) for s in (0.0, 0.02, 0.04, 0.07)]
    plain = "pressure_kpa,s,x,y\n" + "\n".join(rows) + "\n"
    thick = "# t\npressure_kpa,s,x,y,thickness\n" + "\n".join(r + ",0.0145" for r in rows) + "\n"
    return [plain.encode(), thick.encode()]


def use_pressure(path: Path) -> None:
    """Read a pressure history and evaluate it."""
    law = measured_law(path)
    for derivative in (0, 1):
        if not np.isfinite(law(np.linspace(-1, 2, 50), derivative)).all():
            raise Fault(f"{path.name}: a pressure that is not a number")


def kinematics_seeds(folder: Path) -> list[bytes]:
    """A kinematics.h5 of six shapes of four points."""
    knots, time = np.linspace(0, 2e4, 6), np.linspace(0, 0.2, 9)
    box = np.array([[0, 0], [1, 0], [1, 1], [0, 1]]) * 0.01
    values = {
        "time": time, "pressure": 1e5 * time, "shape_parameter": knots, "shape_bend": knots / 1e4,
        "shape_outline": np.stack([box] * 6), "source": "fea", "tip_thickness": 0.0145,
        "root": np.zeros(2), "length": 0.07,
    }  # fmt: skip
    pair = np.tile([0.0, 1.0], (6, 1))
    values |= dict.fromkeys(("shape_tip", "shape_tip_direction", "shape_dorsal_direction"), pair)
    write_kinematics(folder / "k.h5", values)
    return [(folder / "k.h5").read_bytes()]


def use_calibration(path: Path) -> None:
    """Read a calibration and map two points."""
    load_calibration(path).to_m(np.array([[1.0, 2.0], [30.0, 20.0]]))


CALIBRATION = (
    b'{"format": "piv-calibration", "format_version": 1, "scale_mm_per_px": 0.1,'
    b' "origin_x_px": 3.0, "origin_y_px": 2.0'
)
LENS = (
    b', "lens": {"size_px": [64, 48], "camera_matrix": [[80, 0, 32], [0, 80, 24], [0, 0, 1]],'
    b' "distortion": [0.1, 0, 0, 0, 0], "to_sheet": [[1, 0, 0], [0, 1, 0], [0, 0, 1]],'
    b' "reprojection_rms_px": 0.1, "views": 3}, "notes": {}}'
)


def _seeds(*contents: bytes) -> Callable[[Path], list[bytes]]:
    return lambda _: list(contents)


HEADERS = _seeds(*(CIH.format(bits=bits).encode() for bits in (8, 12, 16)))
PIVLAB_METRES = PIVLAB.replace(b"px/frame", b"m/s").replace(b"px", b"m")
PRESSURE = b"t,p\n0,0\n0.1,5000\n0.2,20000\n0.4,2e4\n"
IMAGES, VECTORS = (".png", ".bmp", ".jpg", ".pgm"), (".h5", ".nc")
RAW = {"camera.mraw": bytes(range(256)) * 12}

TARGETS = [
    Target("stack.tif", use_recording, stack_seeds),
    *(Target("image" + suffix, use_recording, partial(encoded, suffix)) for suffix in IMAGES),
    Target("film.avi", use_recording, video_seeds),
    Target("camera.cih", use_recording, HEADERS, beside=RAW),
    Target("images.h5", use_recording, recording_seeds),
    Target("mask.csv", use_mask, _seeds(*POLYGONS)),
    Target("mask.png", use_mask, partial(encoded, ".png")),
    *(Target("vectors" + suffix, use_vectors, partial(written, suffix)) for suffix in VECTORS),
    Target("vectors.txt", use_vectors, _seeds(OPENPIV)),
    Target("davis.txt", use_vectors, _seeds(DAVIS)),
    Target("vectors.dat", use_vectors, _seeds(TECPLOT)),
    Target("insight.vec", use_vectors, _seeds(INSIGHT)),
    Target("imagej.tif", use_recording, imagej_seeds),
    Target("camera.cine", use_recording, cine_seeds),
    Target("pivlab.txt", use_vectors, _seeds(PIVLAB, PIVLAB_METRES)),
    Target("pivlab.mat", use_vectors, mat_seeds),
    Target("davis.vc7", use_vectors, davis_seeds, costs=20),
    Target("plane.h5", lambda p: use_plane(read_checked_plane(p), p), partial(written, ".h5")),
    Target("scene.toml", lambda path: load_scene(path.parent), _seeds(SCENE.read_bytes()), STAGE),
    Target("states.h5", use_states, states_seeds, STAGE),
    Target("states.csv", use_states, states_csv_seeds, STAGE),
    Target("pressure.csv", use_pressure, _seeds(PRESSURE), STAGE),
    Target("kinematics.h5", lambda p: read_kinematics(p).at(0.1), kinematics_seeds, STAGE),
    Target("calibration.json", use_calibration, _seeds(CALIBRATION + LENS, CALIBRATION + b"}")),
]


def named(name: str) -> Target:
    """A target by its file's name."""
    return next(target for target in TARGETS if target.name == name)
