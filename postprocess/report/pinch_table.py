"""The key numbers of a pinch as a table of words."""

from typing import Any

from postprocess.compare.pinch_summary import AFTER
from postprocess.evidence.pair_integrals import LATE
from postprocess.evidence.time_windows import APPROACH
from postprocess.words import PAIRS, quantity

_OF_GAP = "{:g} to {:g} mm of gap".format(*(1e3 * gap for gap in APPROACH))
_LATER = f"{AFTER:g} s after contact"
# Name of the row, its key in the comparison's summary, and its SI unit.
_ROWS = (
    (f"circulation of each tip vortex at its peak, {_OF_GAP}", "circulation_peak", "m²/s"),
    (f"imbalance of the pair, {_OF_GAP} (RMS)", "imbalance_rms", "fraction"),
    (f"mirror distance of the centres, {_OF_GAP} (RMS)", "mirror_distance_rms", "m"),
    (f"vortex beyond the tip, {_OF_GAP}", "along_tip_approach", "m"),
    (f"vortex to the dorsal side, {_OF_GAP}", "across_tip_approach", "m"),
    ("dorsal pair: circulation of each at contact", "dorsal_circulation_at_contact", "m²/s"),
    (
        f"dorsal pair: circulation of each, {_LATER}",
        "dorsal_circulation_after",
        "m²/s",
    ),
    (
        f"dorsal pair: distance from the plane between, {_LATER}",
        "dorsal_from_plane_after",
        "m",
    ),
    (f"dorsal pair: height, {_LATER}", "dorsal_y_after", "m"),
    ("ventral pair: forms at", "ventral_forms_time", "s"),
    ("ventral pair: gap at which it forms", "ventral_forms_gap", "m"),
    (
        "ventral pair: circulation of each at its peak"
        f" (–: still growing {LATE:g} s after contact)",
        "ventral_circulation_peak",
        "m²/s",
    ),
    (
        "ventral pair: that against the dorsal pair's at the same instant",
        "ventral_part",
        "fraction",
    ),
    (
        f"ventral pair: circulation of each, {_LATER}",
        "ventral_circulation_after",
        "m²/s",
    ),
    ("ventral pair: upward flow between, at its fastest", "ventral_rise_peak", "m/s"),
    (f"height at which the flow parts, {_OF_GAP}", "stagnation_y_approach", "m"),
    ("downward jet at its fastest", "jet_peak", "m/s"),
    ("upward flow at its fastest", "rise_peak", "m/s"),
    (f"downward jet within {_LATER}", "jet_peak_after_contact", "m/s"),
    ("pressure between the tips, extreme", "pressure_gap_peak", "Pa"),
)


def pinch_table(numbers: dict[str, Any]) -> tuple[list[str], list[tuple[str, list[str]]]]:
    """Names of the sources, and rows (name, a text per source) that a source measures."""
    sources = [source for source in ("cfd", "piv") if source in numbers]
    rows = [
        (name, [_cell(numbers[source], key, unit) for source in sources])
        for name, key, unit in _ROWS
        if any(numbers[source].get(key) is not None for source in sources)
    ]
    return [PAIRS[source] for source in sources], rows


def _cell(values: dict[str, Any], key: str, unit: str) -> str:
    """The value with the time and gap of a peak; "–" where the source does not measure it."""
    text, at = quantity(values.get(key), unit), values.get(f"{key}_time")
    if values.get(key) is None or at is None:
        return text
    return f"{text} at {at:.3f} s, {values[f'{key}_gap'] * 1e3:.2f} mm of gap"
