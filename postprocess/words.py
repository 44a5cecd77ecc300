"""How a page writes numbers, units and the names of sources: one table of units for every page."""

import math
from typing import Any

import numpy as np

PAIRS = {"cfd": "CFD", "piv": "PIV", "piv-cfd": "PIV against CFD"}
VERDICTS = {True: "agrees", False: "differs", None: "undecided"}
NBSP = "\u00a0"  # keeps a number and its unit on one line
# By SI unit: factor, the unit shown, digits after the point (None: three digits in all).
UNITS: dict[str, tuple[float, str, int | None]] = {
    "m": (1e3, "mm", 2),
    "fraction": (1e2, "%", 1),
    "rad": (180 / math.pi, "°", 1),
    "m²/s": (1e4, "cm²/s", None),
    "m³/s": (1e6, "cm³/s", None),
    "m³/s²": (1e6, "cm³/s²", None),
}
# A laboratory's clock is compared in milliseconds.
_LABORATORY = UNITS | {"s": (1e3, "ms", None)}


def quantity(value: float | str | None, unit: str) -> str:
    """A value in SI as text, in the unit of `UNITS`; "–" for none, a word as it is."""
    if value is None or isinstance(value, str):
        return "–" if value is None else value
    factor, shown, digits = UNITS.get(unit, (1.0, "" if unit == "1" else unit, None))
    value *= factor
    if digits is None and factor != 1.0 and 10 <= abs(value) < 1000:
        digits = 1
    if unit == "1" and 0.99 < value < 1:
        digits = 4  # a correlation
    text = minus(three_digits(value) if digits is None else f"{value:.{digits}f}")
    return text + (NBSP * (shown not in ("", "°")) + shown.replace(" ", NBSP))


def minus(number: str) -> str:
    """A number as text with the minus sign of print."""
    return number.replace("-", "−")


def three_digits(value: float) -> str:
    """Write a number with three digits, never with an exponent."""
    if abs(value) >= 100:
        return f"{value:.0f}"
    return np.format_float_positional(float(f"{value:.3g}"), trim="-")


def measured_text(check: dict[str, Any]) -> str:
    """Measured values of a check with their sources."""
    return ", ".join(
        f"{PAIRS[of]}: {quantity(value, check['unit'])}" for of, value in check["measured"].items()
    )


def size(values: Any, unit: str) -> str:
    """Length of a vector, or a number with its sign, to three digits; times in ms."""
    factor, shown, _ = _LABORATORY.get(unit, (1.0, unit, None))
    values = np.atleast_1d(np.asarray(values, float))
    value = float(values[0]) if values.size == 1 else float(np.hypot(*values))
    return minus(f"{three_digits(value * factor)}{NBSP}{shown}")


def pair(values: Any, unit: str) -> str:
    """One number, or the two coordinates of a place; times in ms; empty where not known."""
    factor, shown, _ = _LABORATORY.get(unit, (1.0, unit, None))
    values = np.atleast_1d(np.asarray(values, float)) * factor
    if not np.isfinite(values).all():
        return ""
    number = f"({values[0]:.2f}, {values[1]:.2f})" if values.size == 2 else f"{values[0]:.4g}"
    return minus(f"{number}{NBSP}{shown}")
