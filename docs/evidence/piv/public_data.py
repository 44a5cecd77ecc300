"""Public image pairs with published displacements, against the peers (make bench-piv).

No setting was set on them. The shared data (small_scene.py) hold copies of the repositories
quenot/opflow, erizmr/UnLiteFlowNet-PIV and shengzesnail/PIV-LiteFlowNet-en in folders of the
repositories' names; none of it may be passed on with the project.
"""

from collections.abc import Callable, Iterator
from pathlib import Path

import cv2
import numpy as np
import pandas as pd
from scipy.ndimage import distance_transform_edt, map_coordinates

from docs.evidence.piv.pages import libraries, write_study
from docs.evidence.piv.scores import EDGE, absent, inner, joined, rms_of, speed, told
from docs.evidence.piv.with_peers import OURS, PEER_NAMES, Pair, compared
from docs.evidence.small_scene import shared_data

QUENOT = "opflow/jeif98/synthetic"  # Quénot et al. 1998: two cylinders
CAI = ("UnLiteFlowNet-PIV/sample_data", "PIV-LiteFlowNet-en/demos/testedData")  # Cai et al. 2019
STRENGTHS = {"cyl10": 0.1, "cyl15": 0.15, "cyl20": 0.2}  # px per unit of the published field
BODY = 100.0  # both components of the published field inside a cylinder
MASKED = "with mask"
INSTANT = ", field of the first picture"
MANY = 0.05  # share of absent vectors from which errors are no longer set against the peers'


def image(path: Path) -> np.ndarray:
    """One image; FileNotFoundError where it cannot be read."""
    out = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    if out is None:
        raise FileNotFoundError(f"{path}: no image; copy the repository there (docstring)")
    return out


def sampled(field: np.ndarray, first: bool = False) -> Callable:
    """flow(x, y) of a displacement (ny, nx, 2; px, y up), halfway or of the `first` picture."""

    def flow(x, y):
        u = v = np.zeros(np.shape(x))
        for _ in range(10 if first else 1):
            # a particle that is here halfway was half its displacement away in the first picture
            at = (y - v / 2, x - u / 2) if first else (y, x)
            rows, columns = field.shape[0] - 1 - at[0], at[1]
            near = {"order": 1, "mode": "nearest"}
            u, v = (map_coordinates(field[..., k], [rows, columns], **near) for k in (0, 1))
        return u, v

    return flow


def cylinders(data: Path) -> Iterator[Pair]:
    """Quénot et al.: clean, noisy, with lost particles; judged EDGE px from the cylinders."""
    for strength, scale in STRENGTHS.items():
        folder = data / QUENOT / strength
        # after six numbers u and v of every pixel, big endian
        raw = np.fromfile(folder / "vitvue.uwo", ">f4", offset=24)
        shape = image(folder / "perfect" / "cylind1.pgm").shape
        field = raw.reshape(*shape, 2).astype(float)
        body = (field == BODY).all(axis=2)
        field = scale * np.where(body[..., None], 0, field)
        size = np.hypot(*field[~body].T).mean()
        clear = (distance_transform_edt(~body) > EDGE).astype(np.uint8)

        def counts(x, y, clear=clear):
            rows = clear.shape[0] - 1 - y
            return inner(clear.shape)(x, y) & (map_coordinates(clear, [rows, x], order=0) > 0)

        for kind in sorted(p.name for p in folder.iterdir() if p.is_dir()):
            # the field belongs to the middle of four images
            first, second = (image(folder / kind / f"cylind{k}.pgm") for k in (1, 2))
            label = f"cylinders, {size:.0f} px" + (", noise" * ("noise" in kind or "mixed" in kind))
            rows = {label: (sampled(field), counts)}
            yield Pair(
                f"{strength}_{kind}", (first, second), rows, {OURS: {}, MASKED: {"mask": body}}
            )


def simulated(data: Path) -> Iterator[Pair]:
    """Cai et al.: particles moved by computed flows."""
    for path in sorted(p for folder in CAI for p in (data / folder).rglob("*.flo")):
        stem = path.name.replace("_flow.flo", "").replace("_gt.flo", "")
        a, b = (image(path.with_name(f"{stem}_img{k}.tif")) for k in (1, 2))
        field = np.fromfile(path, "<f4", offset=12).reshape(*a.shape, 2) * np.array([1.0, -1.0])
        group = stem.split("_0")[0].split("_Re")[0].removesuffix("_hd")
        ways, counts = (False, True), inner(a.shape)
        rows = {group + INSTANT * first: (sampled(field, first), counts) for first in ways}
        yield Pair(f"{path.parent.name}_{stem}", (a, b), rows)


def cell(parts: list) -> str:
    """RMS error and mean error length where every method has a vector, and absent share."""
    e = joined(parts)
    text = f"{rms_of(parts):.3f}/{np.hypot(*e.e[:, e.common]).mean():.3f}"
    return text + (f" ({absent(parts):.0%} absent)" if absent(parts) > 0.005 else "")


def study() -> None:
    """Errors of every method, and what is told of our own vectors."""
    data = shared_data() or Path("shared", "data")
    if missing := [f for f in (QUENOT, *CAI) if not (data / f).is_dir()]:
        # a benchmark without them keeps the table that it has
        print(f"{data / missing[0]}: no folder, so public pairs are left out")
        return
    results: dict = {}
    for source in (cylinders, simulated):  # pairs of one folder have one size
        for name, rows in compared(f"public_{source.__name__}", source(data)).items():
            results.setdefault(name, {}).update(rows)
    names = sorted(results, key=lambda n: n not in (OURS, MASKED))
    errors, own = [], []
    for row, parts in results[OURS].items():
        there = {n: results[n][row] for n in names if row in results[n]}
        ratio = "–"
        if absent(parts) <= MANY:
            found = [(n, rms_of(there[n])) for n in there]
            best = (min(e for n, e in found if n.startswith(p)) for p in PEER_NAMES)
            ratio = ", ".join(f"{b / rms_of(parts):.2f}×" for b in best)
        cells = {n: cell(there[n]) if n in there else "" for n in names}
        last = {"best OpenPIV, best PIVtools over ours": ratio}
        errors.append({"flow (pairs)": f"{row} ({len(parts)})"} | cells | last)
        for name in (OURS, MASKED):
            if name in there and not row.endswith(INSTANT):
                label, of = f"{row}{f', {name}' * (name != OURS)}", there[name]
                own.append({"flow": label} | told(of) | {"vectors/s": f"{speed(of):,.0f}"})
    caption = (
        "RMS error per component, px, where every method gives a vector; after the slash the mean"
        " length of the error"
    )
    write_study("public", [pd.DataFrame(errors), pd.DataFrame(own)], caption, f"{libraries()}.")
