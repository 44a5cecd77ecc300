"""Run the peers in their own environment: python peers.py FOLDER, one pair.npz per case.

Results of the same images that are there already are kept, so that a run that was stopped goes on
where it was.
"""

import hashlib
import os
import sys
import tempfile
import time
from collections.abc import Callable
from importlib.metadata import distributions
from pathlib import Path
from typing import Any

os.environ["OMP_NUM_THREADS"] = "1"
import numpy as np
import yaml

OPENPIV = {  # window sizes, overlaps, lax validation
    "OpenPIV 64-32-16": ((64, 32, 16), (32, 16, 8), False),
    "OpenPIV 24 lax": ((64, 48, 24), (32, 24, 16), True),
    "OpenPIV 32 lax": ((64, 32, 32), (32, 16, 24), True),
    "OpenPIV 32, 75 %": ((64, 32, 32), (32, 16, 24), False),
}
PIVTOOLS = {
    "PIVtools 64-32-32": ([[64, 64], [32, 32], [32, 32]], [50, 50, 75]),
    "PIVtools 64-32-16": ([[64, 64], [32, 32], [16, 16]], [50, 50, 50]),
}
FLUIDIMAGE = {"fluidimage 64-32-16": (64, 3), "fluidimage 48-24": (48, 2)}  # window, passes


def openpiv(a, b, mask, windows, overlaps, lax):
    """x, y (up), u, v of windef's multi-pass, axes ascending; mask (bool) or None."""
    from openpiv import windef
    from openpiv.settings import PIVSettings

    s = PIVSettings()
    s.windowsizes, s.overlap, s.num_iterations = windows, overlaps, len(windows)
    if lax:
        s.median_threshold, s.std_threshold = 20, 30
        s.sig2noise_validate, s.sig2noise_method = False, None
    s.static_mask = mask
    x, y, u, v, _ = windef.simple_multipass(a.astype(np.int32), b.astype(np.int32), s)
    order = np.argsort(y[:, 0])
    return x[0], y[order, 0], np.asarray(u)[order], np.asarray(v)[order]


def fluidimage(a, b, _, window, passes):
    """Its multi-pass with windows that move by whole pixels; places lie up to 0.5 px off a grid.

    It has no masks of pixels.
    """
    from fluidimage.data_objects.piv import ArrayCouple
    from fluidimage.works.piv.multipass import WorkPIV

    params = WorkPIV.create_default_params()
    params.piv0.shape_crop_im0, params.multipass.number = window, passes
    params.multipass.use_tps = False
    couple = ArrayCouple(names=("a", "b"), arrays=(a.astype(float), b.astype(float)))
    last = WorkPIV(params).calcul(couple).passes[-1]
    (x, column), (y, row) = (
        np.unique(np.floor(places), return_inverse=True) for places in (last.xs, last.ys)
    )
    u, v = np.full((2, y.size, x.size), np.nan)
    u[row, column], v[row, column] = last.deltaxs, -last.deltays
    return x + 0.25, a.shape[0] - 1.25 - y[::-1], u[::-1], v[::-1]


class PIVtools:
    """One configuration of PIVtools' instantaneous correlator."""

    def __init__(self, windows, overlaps, shape):
        from pivtools_cli.cli import create_default_config
        from pivtools_cli.piv.piv_backend.cpu_instantaneous import InstantaneousCorrelatorCPU
        from pivtools_core.config import Config

        path = Path(tempfile.mkdtemp()) / "config.yaml"
        create_default_config(str(path))
        settings = yaml.safe_load(path.read_text())
        settings["processing"]["omp_threads"] = 1
        settings["images"]["shape"] = list(shape)
        windowed = {"window_size": windows, "overlap": overlaps, "runs": [len(windows)]}
        settings["instantaneous_piv"] |= windowed | {"image_warp_interpolation": "lanczos"}
        path.write_text(yaml.safe_dump(settings))
        self.config = Config(str(path))
        self.config._detected_image_shape = tuple(shape)
        self.correlator = InstantaneousCorrelatorCPU(self.config)

    def __call__(self, a, b, mask):
        from pivtools_core.image_handling.load_images import compute_vector_mask

        images = np.stack([a, b])[None].astype(np.float32)
        masks = None if mask is None else compute_vector_mask(mask, self.config, ensemble=False)
        result = self.correlator.correlate_batch(images, self.config, masks)
        last = (result[0] if isinstance(result, list) else result).passes[-1]
        y = a.shape[0] - 1 - np.array(last.win_ctrs_y)[::-1]
        u, v = np.array(last.ux_mat, float), -np.array(last.uy_mat, float)
        if mask is not None:  # windows that are mostly masked have 0
            u[last.b_mask], v[last.b_mask] = np.nan, np.nan
        return np.array(last.win_ctrs_x), y, u[::-1], v[::-1]


def main(folder: Path) -> None:
    """Correlate every pair of the folder with every peer; CPU seconds beside the vectors."""
    files = sorted(folder.glob("*.pair.npz"))
    digests = {f: digest(f) for f in files}
    files = [f for f in files if not done(result_of(f), digests[f])]
    if not files:
        return
    shape = np.load(files[0])["a"].shape
    methods: dict[str, Callable] = {
        n: (lambda a, b, mask, s=s: openpiv(a, b, mask, *s)) for n, s in OPENPIV.items()
    }
    methods |= {
        n: (lambda a, b, mask, s=s: fluidimage(a, b, mask, *s)) for n, s in FLUIDIMAGE.items()
    }
    methods |= {n: PIVtools(*s, shape) for n, s in PIVTOOLS.items()}
    warm = images_of(files[0])
    for method in methods.values():
        method(*warm)
    for file in files:
        pair = images_of(file)
        out: dict[str, Any] = {"digest": digests[file]}
        for k, (name, method) in enumerate(methods.items()):
            start = time.process_time()
            x, y, u, v = method(*pair)
            found = {"t": time.process_time() - start, "x": x, "y": y, "u": u, "v": v, "name": name}
            out |= {f"{k}_{key}": value for key, value in found.items()}
        part = file.with_suffix(".part")
        with part.open("wb") as whole:
            np.savez(whole, **out)
        part.rename(result_of(file))
        print(file.name, flush=True)


def images_of(file: Path) -> tuple[Any, Any, Any]:
    """Both images of a pair, and its mask (bool, true = body) or None."""
    pair = np.load(file)
    return pair["a"], pair["b"], pair["mask"] if "mask" in pair.files else None


def digest(file: Path) -> str:
    """Of the images of a pair, of what the peers are asked for, and of the installed libraries."""
    images = b"".join(image.tobytes() for image in images_of(file) if image is not None)
    installed = sorted(f"{d.name} {d.version}" for d in distributions())
    asked = repr((OPENPIV, PIVTOOLS, FLUIDIMAGE, installed)).encode()
    return hashlib.sha256(images + asked).hexdigest()


def result_of(file: Path) -> Path:
    """Where the peers' vectors of a pair are written."""
    return file.with_name(file.name.replace(".pair.", ".peers."))


def done(result: Path, digest: str) -> bool:
    """Whether the peers have measured this very pair."""
    return result.exists() and str(np.load(result)["digest"]) == digest


if __name__ == "__main__":
    main(Path(sys.argv[1]))
