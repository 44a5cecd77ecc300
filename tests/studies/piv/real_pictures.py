"""Public pairs of real pictures: what share of the vectors is called valid, and what it costs not to call wrong ones so."""

from __future__ import annotations

import cv2

from piv.correlation.pair import correlate_pair
from tests.shared_data import shared_data
from tests.studies.piv.scores import without_count_of_cells

PAIRS = {
    "convection fingers (jruebsam/pypiv)": "pypiv_finger/real_ana_finger_{}.tif 0 1",
    "Kármán street (Shrediquette/PIVlab)": "pivlab_karman/PIVlab_Karman_{}.bmp 01 02",
    "16-bit pair (lento234/pivuq)": "pivuq_particledisparity/B000{}.tif 10 11",
}
ANY = 100.0  # px: no vector is less sure


def valid_share(a, b, limited: bool) -> float:
    """Share of the vectors called valid, with the limit on uncertainty and the count of cells or without both."""
    if limited:
        return float(correlate_pair(a, b)["valid"].mean())
    with without_count_of_cells():
        return float(correlate_pair(a, b, max_std=ANY)["valid"].mean())


def real_pictures() -> str:
    """A line of Markdown."""
    data, shares = shared_data(), []
    for label, files in PAIRS.items():
        name, *numbers = files.split()
        if data is None or not (data / name.format(numbers[0])).exists():
            shares.append(f"{label} not at hand")
            continue
        images = [cv2.imread(str(data / name.format(n)), cv2.IMREAD_UNCHANGED) for n in numbers]
        a, b = (i[..., 0] if i.ndim == 3 else i for i in images)
        shares.append(f"{label} {valid_share(a, b, True):.1%} ({valid_share(a, b, False):.1%})")
    return (
        "- Real pictures, vectors called valid (without `max_std` and the count of cells): "
        + ", ".join(shares)
        + "."
    )
