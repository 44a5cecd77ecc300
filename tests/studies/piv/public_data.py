"""Public image pairs with published exact displacements, against the peers: python -m tests.studies.piv.public_data [--docs].

Nothing was tuned on them. The shared data (tests/shared_data.py) hold copies of the repositories quenot/opflow,
erizmr/UnLiteFlowNet-PIV and shengzesnail/PIV-LiteFlowNet-en in folders of the repositories' names; none of it may be
passed on with the project. --docs writes the table into docs/piv_benchmarks.md.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")
import cv2
import numpy as np
from scipy.ndimage import distance_transform_edt, map_coordinates

from piv.correlation.pair import correlate_pair
from tests.shared_data import shared_data
from tests.studies.pages import PIV, libraries, write_between
from tests.studies.piv.benchmark import EDGE, pairs_folder, peer_python

FAR = 0.5  # px
QUENOT = "opflow/jeif98/synthetic"  # Quénot et al. 1998: two cylinders, 7, 10 and 14 px on average
CAI = ("UnLiteFlowNet-PIV/sample_data", "PIV-LiteFlowNet-en/demos/testedData")  # Cai et al. 2019
STRENGTHS = {"cyl10": 0.1, "cyl15": 0.15, "cyl20": 0.2}  # px per unit of the published field
BODY = 100.0  # both components of the published field inside a cylinder
OWN = "this project"


@dataclass(frozen=True, eq=False)
class Pair:
    """Two images and the exact displacement (ny, nx, 2; px, right and up) at each pixel, halfway between them in time."""

    group: str
    name: str
    a: np.ndarray
    b: np.ndarray
    field: np.ndarray
    judged: np.ndarray  # bool, pixels: vectors there are compared


def inner(shape: tuple[int, int]) -> np.ndarray:
    """Pixels (bool) at least EDGE px from the border."""
    out = np.zeros(shape, bool)
    out[EDGE:-EDGE, EDGE:-EDGE] = True
    return out


def image(path: Path) -> np.ndarray:
    """One image; FileNotFoundError where it cannot be read."""
    out = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    if out is None:
        raise FileNotFoundError(
            f"{path}: no image; copy the repository there as this module's docstring says"
        )
    return out


def cylinders(data: Path) -> Iterator[Pair]:
    """Quénot et al.: particles as they are, with noise, with particles lost, with both; judged EDGE px from the cylinders."""
    for strength, scale in STRENGTHS.items():
        folder = data / QUENOT / strength
        # after six numbers u and v of every pixel, big endian
        raw = np.fromfile(folder / "vitvue.uwo", ">f4", offset=24)
        first = image(folder / "perfect" / "cylind1.pgm")
        field = raw.reshape(*first.shape, 2).astype(float)
        body = (field == BODY).all(axis=2)
        judged = inner(first.shape) & (distance_transform_edt(~body) > EDGE)
        for kind in sorted(p.name for p in folder.iterdir() if p.is_dir()):
            # the field belongs to the middle of four images
            a, b = (image(folder / kind / f"cylind{k}.pgm") for k in (1, 2))
            label = f"cylinders, {strength[3:]}" + (", noise" * ("noise" in kind or "mixed" in kind))
            yield Pair(label, f"{strength}_{kind}", a, b, scale * np.where(body[..., None], 0, field), judged)


def simulated(data: Path) -> Iterator[Pair]:
    """Cai et al.: particles moved by computed flows."""
    for path in sorted(p for folder in CAI for p in (data / folder).rglob("*.flo")):
        stem = path.name.replace("_flow.flo", "").replace("_gt.flo", "")
        a, b = (image(path.with_name(f"{stem}_img{k}.tif")) for k in (1, 2))
        field = np.fromfile(path, "<f4", offset=12).reshape(*a.shape, 2) * np.array([1.0, -1.0])
        name = path.parent.name + "_" + stem
        yield Pair(stem.split("_0")[0].split("_Re")[0].removesuffix("_hd"), name, a, b, field, inner(a.shape))


def errors(pair: Pair, x, y, u, v) -> tuple[np.ndarray, np.ndarray]:
    """Errors (2, n; NaN where absent) of the judged vectors, and which vectors these are."""
    gx, gy = np.meshgrid(x, pair.a.shape[0] - 1 - np.asarray(y))
    true = [map_coordinates(pair.field[..., k], [gy, gx], order=1, mode="nearest") for k in (0, 1)]
    where = pair.judged[np.rint(gy).astype(int), np.rint(gx).astype(int)]
    return np.stack([u - true[0], v - true[1]])[:, where], where


def run(data: Path, keep: Path | None) -> dict:
    """Of each method and group: errors of each pair, CPU seconds, number of vectors; of ours also what is told of them."""
    results: dict = {}
    with pairs_folder(keep) as folder:
        for source in (cylinders, simulated):
            jobs = {folder / source.__name__ / f"{p.name}.pair.npz": p for p in source(data)}
            next(iter(jobs)).parent.mkdir(exist_ok=True)
            for file, pair in jobs.items():
                np.savez(file, a=pair.a, b=pair.b)
                if not results:
                    correlate_pair(pair.a, pair.b)
                start = time.process_time()
                ds = correlate_pair(pair.a, pair.b)
                seconds = time.process_time() - start
                e, where = errors(pair, *(ds[n].values for n in "xyuv"))
                given = np.isfinite(e).all(axis=0)
                std = np.stack([ds["u_std"].values, ds["v_std"].values])[:, where][:, given]
                plain = given & (ds["flag"].values[where] != 5)
                told = (np.abs(e[:, given]) < std, np.hypot(*e[:, plain]) > FAR)
                add(results, OWN, pair.group, (e, seconds, ds["u"].size, *told))
            subprocess.run([peer_python(), Path(__file__).with_name("peers.py"), file.parent], cwd=folder,
                           check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)  # fmt: skip
            for file, pair in jobs.items():
                r = np.load(file.with_name(file.name.replace(".pair.", ".peers.")))
                for k in range(sum(n.endswith("_name") for n in r.files)):
                    e, _ = errors(pair, *(r[f"{k}_{n}"] for n in "xyuv"))
                    add(results, str(r[f"{k}_name"]), pair.group, (e, float(r[f"{k}_t"]), r[f"{k}_u"].size))
    return results


def add(results: dict, method: str, group: str, row: tuple) -> None:
    """Append the results of a pair."""
    results.setdefault(method, {}).setdefault(group, []).append(row)


def joined(rows: list[tuple], k: int) -> np.ndarray:
    """The k-th entries of all pairs, side by side."""
    return np.concatenate([r[k].reshape(-1, r[k].shape[-1]) for r in rows], axis=1)


def tables(results: dict) -> str:
    """Markdown: errors of every method, and what is told of our own vectors."""
    names = list(results)
    lines = ["RMS error per component, px; after the slash the mean length of the error", "",
             "| flow (pairs) | " + " | ".join(names) + " | best OpenPIV, best PIVtools over ours |", "|---" * (len(names) + 2) + "|"]  # fmt: skip
    own = ["| flow | coverage of ±1 standard uncertainty | unflagged > 0.5 px | absent | vectors/s |", "|---|---|---|---|---|"]  # fmt: skip
    for group, rows in results[OWN].items():
        cells, root = [], {}
        for name in names:
            e = joined(results[name][group], 0)
            root[name] = float(np.sqrt(np.nanmean(e**2)))
            cells.append(f"{root[name]:.3f}/{np.nanmean(np.hypot(*e)):.3f}")
        best = [
            min(v for n, v in root.items() if n.startswith(p)) / root[OWN] for p in ("OpenPIV", "PIVtools")
        ]
        lines.append(
            f"| {group} ({len(rows)}) | " + " | ".join(cells) + f" | {best[0]:.2f}×, {best[1]:.2f}× |"
        )
        absent = 1 - np.isfinite(joined(rows, 0)).all(axis=0).mean()
        speed = sum(r[2] for r in rows) / sum(r[1] for r in rows)
        own.append(f"| {group} | {joined(rows, 3).mean():.0%} | {joined(rows, 4).mean():.2%} | {absent:.2%} | {speed:,.0f} |")  # fmt: skip
    return "\n".join([*lines, "", *own, "", f"{libraries()}."])


def main() -> None:
    """Run, print, and write to the docs where asked."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--folder", type=Path, help="keep pairs and peers' results there; a stopped run goes on"
    )
    parser.add_argument("--docs", action="store_true", help="write the table into docs/piv_benchmarks.md")
    args = parser.parse_args()
    data = shared_data() or Path("shared", "data")
    if missing := [f for f in (QUENOT, *CAI) if not (data / f).is_dir()]:
        # a benchmark without them keeps the table that it has
        print(
            f"{data / missing[0]}: no folder, so public pairs are left out; copy {missing[0].split('/')[0]} there"
        )
        return
    cv2.setNumThreads(1)
    text = tables(run(data, args.folder))
    print(text)
    if args.docs:
        write_between(PIV, "public", text)


if __name__ == "__main__":
    main()
