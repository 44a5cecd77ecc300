"""Values with their units, and what a check has measured, as a person reads them."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

PAIRS = {
    "cfd": "CFD",
    "piv": "PIV",
    "piv-cfd": "PIV against CFD",
}

SHOWN = {
    "m²/s": (1e4, "cm²/s"),
    "m³/s": (1e6, "cm³/s"),
    "m³/s²": (1e6, "cm³/s²"),
}  # factor and unit for a person
NBSP = "\u00a0"  # keeps a number and its unit on one line


def number(value: float) -> str:
    """Three digits, never with an exponent."""
    return (
        f"{value:.0f}"
        if abs(value) >= 100
        else np.format_float_positional(float(f"{value:.3g}"), trim="-")
    )


def quantity(value: float | str | None, unit: str) -> str:
    """One value with its unit as a person reads it: metres below 1 m in mm, of circulation and flux cm, fractions in per cent."""
    if value is None:
        return "–"
    if isinstance(value, str):
        return value
    if unit == "m":
        return f"{value * 1e3:.2f}{NBSP}mm"
    if unit == "fraction":
        return f"{value * 100:.1f}{NBSP}%"
    if unit == "rad":
        return f"{math.degrees(value):.1f}°"
    if unit in SHOWN:
        factor, unit = SHOWN[unit]
        value *= factor
        if 10 <= abs(value) < 1000:
            return f"{value:.1f}{NBSP}{unit}"
    return number(value) + (NBSP + unit.replace(" ", NBSP) if unit not in ("", "1") else "")


def measured_text(check: dict[str, Any]) -> str:
    """Measured values of a check with their sources."""
    return ", ".join(
        f"{PAIRS[of]}: {quantity(value, check['unit'])}" for of, value in check["measured"].items()
    )
