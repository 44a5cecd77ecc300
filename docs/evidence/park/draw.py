"""Further own fingers for the park, drawn by a seed from the same ranges as its table."""

from typing import Any

import numpy as np


def drawn(seed: int, count: int = 12) -> list[dict[str, Any]]:
    """Entries as of tests/park/scenes.toml."""
    rng = np.random.default_rng(seed)
    return [_entry(rng, f"drawn_{seed}_{k + 1}", k) for k in range(count)]


def _entry(rng: np.random.Generator, name: str, number: int) -> dict[str, Any]:
    length = float(np.round(rng.uniform(30, 120)))
    width = float(np.round(rng.uniform(12, 40)))
    pinch = number % 4 == 1
    # what bends an actuator of Dragon Skin 30 by 30 to 120 degrees, which softer ones reach sooner
    kpa = float(np.round(rng.uniform(10, 30)))
    kind = ("ramp", "valve", "ramp", "sine")[number % 4] if not pinch else "valve"
    rise = float(np.round(10 ** rng.uniform(np.log10(0.03), np.log10(5.0)), 3))
    rise = min(max(rise, 0.5), 2.0) if kind == "sine" else rise if kind == "ramp" else rise / 10
    how = {
        "kind": kind,
        "kpa": [kpa],
        "rise": round(rise, 4),
        "hold": 2 * rise if kind == "sine" else 0.3,
    }
    if kind == "valve":
        how |= {"noise": float(np.round(rng.uniform(50, 300))), "hold": 0.4}
    height = float(np.round(max(1.9 * length, length + 110) + rng.uniform(0, 60)))
    tank = f"{3 * length + 150 + 150 * pinch:.0f}x{height:.0f}x{rng.uniform(150, 300):.0f}"
    entry: dict[str, Any] = {
        "name": name, "length": f"{length:g}mm", "width": f"{width:g}mm", "tank": tank,
        "pressure": how,
    }  # fmt: skip
    keys = ""
    if pinch:
        half = rng.uniform(0.55, 0.9) * length
        entry["extends"], keys = "cases/pinch", f"[pinch]\nhalf_distance = {1e-3 * half:.4f}\n"
    elif number % 6 == 2:
        keys = (
            f'[[obstacle]]\nshape = "circle"\ncentre = [{1.3e-3 * length:.3f}, 0.03]\n'
            "diameter = 0.015\n"
        )
    elif number % 6 == 4:
        keys = '[actuator.materials.lower]\nmaterial = "Smooth-Sil 950"\n'
    return entry | {"keys": keys, "about": "pinch" if pinch else "one finger", "alone": True}
