"""Public image pairs with published displacements, against the peers (make bench-piv).

No setting was set on them. The shared data (tests/shared_data.py) hold copies of the repositories
quenot/opflow, erizmr/UnLiteFlowNet-PIV and shengzesnail/PIV-LiteFlowNet-en in folders of the
repositories' names; none of it may be passed on with the project. --docs writes the table into
docs/piv_benchmarks.
"""

import os
from collections.abc import Callable, Iterator
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")
import cv2
import numpy as np
from scipy.ndimage import distance_transform_edt, map_coordinates

from tests.shared_data import shared_data
from tests.studies.pages import libraries, write_study
from tests.studies.piv.scores import EDGE, TOLD, absent, inner, joined, rms_of, speed, told
from tests.studies.piv.with_peers import OURS, Pair, arguments, compared

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
        raise FileNotFoundError(
            f"{path}: no image; copy the repository there as this module's docstring says"
        )
    return out


def sampled(field: np.ndarray, first: bool = False) -> Callable:
    """flow(x, y) of a displacement (ny, nx, 2; px, y up), halfway or of the `first` picture."""

    def flow(x, y):
        u = v = np.zeros(np.shape(x))
        for _ in range(10 if first else 1):
            # a particle that is here halfway was half its displacement away in the first picture
            at = (y - v / 2, x - u / 2) if first else (y, x)
            rows, columns = field.shape[0] - 1 - at[0], at[1]
            u, v = (
                map_coordinates(field[..., k], [rows, columns], order=1, mode="nearest")
                for k in (0, 1)
            )
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
            images = tuple(image(folder / kind / f"cylind{k}.pgm") for k in (1, 2))
            label = f"cylinders, {size:.0f} px" + (", noise" * ("noise" in kind or "mixed" in kind))
            rows = {label: (sampled(field), counts)}
            yield Pair(f"{strength}_{kind}", images, rows, {OURS: {}, MASKED: {"mask": body}})


def simulated(data: Path) -> Iterator[Pair]:
    """Cai et al.: particles moved by computed flows."""
    for path in sorted(p for folder in CAI for p in (data / folder).rglob("*.flo")):
        stem = path.name.replace("_flow.flo", "").replace("_gt.flo", "")
        a, b = (image(path.with_name(f"{stem}_img{k}.tif")) for k in (1, 2))
        field = np.fromfile(path, "<f4", offset=12).reshape(*a.shape, 2) * np.array([1.0, -1.0])
        group = stem.split("_0")[0].split("_Re")[0].removesuffix("_hd")
        rows = {
            group + INSTANT * first: (sampled(field, first), inner(a.shape))
            for first in (False, True)
        }
        yield Pair(f"{path.parent.name}_{stem}", (a, b), rows)


def cell(parts: list) -> str:
    """RMS error and mean error length where every method has a vector, and absent share."""
    e = joined(parts)
    text = f"{rms_of(parts):.3f}/{np.hypot(*e.e[:, e.common]).mean():.3f}"
    return text + (f" ({absent(parts):.0%} absent)" if absent(parts) > 0.005 else "")


def tables(results: dict) -> str:
    """Markdown: errors of every method, and what is told of our own vectors."""
    names = sorted(results, key=lambda n: n not in (OURS, MASKED))
    lines = [
        "RMS error per component, px, where every method gives a vector; after the slash the mean "
        "length of the error",
        "",
        "| flow (pairs) | " + " | ".join(names) + " | best OpenPIV, best PIVtools over ours |",
        "|---" * (len(names) + 2) + "|",
    ]
    own = [f"| flow | {TOLD} vectors/s |", "|---" * 6 + "|"]
    for row, parts in results[OURS].items():
        there = {n: results[n][row] for n in names if row in results[n]}
        ratio = "–"
        if absent(parts) <= MANY:
            best = (
                min(rms_of(there[n]) for n in there if n.startswith(p))
                for p in ("OpenPIV", "PIVtools")
            )
            ratio = ", ".join(f"{b / rms_of(parts):.2f}×" for b in best)
        cells = [cell(there[n]) if n in there else "" for n in names]
        lines.append(f"| {row} ({len(parts)}) | " + " | ".join(cells) + f" | {ratio} |")
        if not row.endswith(INSTANT):
            own += [
                f"| {row}{f', {n}' * (n != OURS)} | {told(there[n])} {speed(there[n]):,.0f} |"
                for n in (OURS, MASKED)
                if n in there
            ]
    return "\n".join([*lines, "", *own, "", f"{libraries()}."])


def main() -> None:
    """Run, print, and write to the docs where asked."""
    args = arguments(__doc__)
    data = shared_data() or Path("shared", "data")
    if missing := [f for f in (QUENOT, *CAI) if not (data / f).is_dir()]:
        # a benchmark without them keeps the table that it has
        print(
            f"{data / missing[0]}: no folder, so public pairs are left out; copy "
            f"{missing[0].split('/')[0]} there"
        )
        return
    cv2.setNumThreads(1)
    results: dict = {}
    for source in (cylinders, simulated):  # pairs of one folder have one size
        keep = args.folder and args.folder / source.__name__
        for name, rows in compared(keep, source(data)).items():
            results.setdefault(name, {}).update(rows)
    text = tables(results)
    print(text)
    if args.docs:
        write_study("public", text)


if __name__ == "__main__":
    main()
