"""Lengths with a unit in the text of an option, such as 50mm or 400x250x250."""

import re

from piv.files.errors import StageError

_UNITS = {"mm": 1e-3, "cm": 1e-2, "m": 1.0}


def lengths(text: str, key: str, count: int, unit: str = "") -> tuple[float, ...]:
    """Metres of a text such as "50mm" or "400x250x250"; `unit`: where it has none. StageError."""
    numbers = "[x×]".join([r"([\d.]+)"] * count)
    match = re.fullmatch(rf"\s*{numbers}\s*(mm|cm|m)?\s*", text)
    *parts, given = match.groups() if match else ("",)
    unit = given or unit
    try:
        values = tuple(float(part) * _UNITS[unit] for part in parts)
    except (KeyError, ValueError):
        values = ()
    if not values or min(values) <= 0:
        example = "400x250x250 (mm: length, height, depth)" if count > 1 else "50mm"
        raise StageError(f"{key} {text}: give {example}")
    return tuple(round(value, 9) for value in values)
