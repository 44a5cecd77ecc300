"""The key numbers of a pinch as a table of words."""

from __future__ import annotations

from typing import Any

from postprocess.compare.pinch_summary import APPROACH
from postprocess.draw.quantity_text import PAIRS, quantity

FROM, TO = (f"{gap * 1e3:g}" for gap in APPROACH)
OF_GAP = f"{FROM} to {TO} mm of gap"

# name of the row, key of pinch_summary.source_numbers, unit, keys of the time and the gap at which it is reached
ROWS = (
    (f"circulation of each tip vortex at its peak, {OF_GAP} (fit)", "circulation_peak", "m²/s", ()),
    (f"imbalance of the pair, {OF_GAP} (RMS)", "imbalance_rms", "fraction", ()),
    (f"mirror distance of the centres, {OF_GAP} (RMS)", "mirror_distance_rms", "m", ()),
    (f"vortex beyond the tip, {OF_GAP}", "along_tip_approach", "m", ()),
    (f"vortex to the dorsal side, {OF_GAP}", "across_tip_approach", "m", ()),
    ("the same from the plane between the fingers, in core radii, at its least", "core_radii_from_plane_approach", "1", ()),
    ("dorsal pair: circulation of each at contact", "dorsal_circulation_at_contact", "m²/s", ()),
    ("dorsal pair: circulation of each, 0.15 s after contact", "dorsal_circulation_after", "m²/s", ()),
    ("dorsal pair: distance from the plane between, 0.15 s after contact", "dorsal_from_plane_after", "m", ()),
    ("dorsal pair: height, 0.15 s after contact", "dorsal_y_after", "m", ()),
    ("ventral pair: forms at", "ventral_forms_time", "s", ()),
    ("ventral pair: gap at which it forms", "ventral_forms_gap", "m", ()),
    ("ventral pair: circulation of each at its peak (–: still growing 0.3 s after contact)", "ventral_circulation_peak", "m²/s", ("ventral_circulation_peak_time", "ventral_circulation_peak_gap")),
    ("ventral pair: that against the dorsal pair's at the same instant", "ventral_part", "fraction", ()),
    ("ventral pair: circulation of each, 0.15 s after contact", "ventral_circulation_after", "m²/s", ()),
    ("ventral pair: upward flow between, at its fastest", "ventral_rise_peak", "m/s", ()),
    ("half plane: circulation, 0.15 s after contact", "half_circulation_after", "m²/s", ()),
    ("half plane: vertical impulse per depth and density, 0.15 s after contact", "half_impulse_after", "m³/s", ()),
    ("jet 20 mm below the tips: speed at its fastest", "jet_speed_20mm_peak", "m/s", ()),
    ("jet 20 mm below the tips: momentum flux per depth and density", "jet_flux_20mm_peak", "m³/s²", ()),
    ("jet 30 mm below the tips: speed at its fastest", "jet_speed_30mm_peak", "m/s", ()),
    ("jet 30 mm below the tips: momentum flux per depth and density", "jet_flux_30mm_peak", "m³/s²", ()),
    ("jet 40 mm below the tips: speed at its fastest", "jet_speed_40mm_peak", "m/s", ()),
    ("jet 40 mm below the tips: momentum flux per depth and density", "jet_flux_40mm_peak", "m³/s²", ()),
    ("circulation of half the plane that walls, flow and diffusion do not explain, until contact, over its peak", "circulation_unexplained", "fraction", ()),
    ("the same, after contact", "circulation_unexplained_after", "fraction", ()),
    ("vertical impulse of the plane flow (two dimensions only) against the fingers' forces per width, largest difference over its peak", "impulse_unexplained", "fraction", ()),
    (f"height at which the flow parts, {OF_GAP}", "stagnation_y_approach", "m", ()),
    ("downward jet at its fastest", "jet_peak", "m/s", ("jet_peak_time", "jet_peak_gap")),
    ("upward flow at its fastest", "rise_peak", "m/s", ("rise_peak_time", "rise_peak_gap")),
    ("downward jet within 0.15 s after contact", "jet_peak_after_contact", "m/s", ()),
    ("pressure between the tips, extreme", "pressure_gap_peak", "Pa", ("pressure_gap_peak_time", "pressure_gap_peak_gap")),
    ("largest pressure at the tips", "pressure_tip_max_peak", "Pa", ("pressure_tip_max_peak_time", "pressure_tip_max_peak_gap")),
    ("least pressure at the tips", "pressure_tip_min_peak", "Pa", ("pressure_tip_min_peak_time", "pressure_tip_min_peak_gap")),
)  # fmt: skip


def pinch_table(numbers: dict[str, Any]) -> tuple[list[str], list[tuple[str, list[str]]]]:
    """Names of the columns (sources), and rows (name, a text per source); "–" where a source does not measure it."""
    sources = [source for source in ("cfd", "piv") if source in numbers]
    rows = []
    for name, key, unit, at in ROWS:
        if all(numbers[source].get(key) is None for source in sources):
            continue
        rows.append((name, [_cell(numbers[source], key, unit, at) for source in sources]))
    return [PAIRS[source] for source in sources], rows


def _cell(values: dict[str, float | None], key: str, unit: str, at: tuple[str, ...]) -> str:
    value = values.get(key)
    if value is None:
        return "–"
    text = quantity(value, unit)
    if at and values.get(at[0]) is not None:
        text += f" at {values[at[0]]:.3f} s, {(values[at[1]] or 0.0) * 1e3:.2f} mm of gap"
    return text
