"""The paper's Fig. 9 with the elastic finger: bending radius and actuation time in air and in water, and what decides them.

python -m tests.studies.air_and_water   (make air-and-water; writes docs/coupling.md between its marks and docs/air_and_water.csv)
At rest the chain is all there is. In motion the water is the modelled one, with the coefficients of the closing stroke: whole
runs with the solver take hours, and the times differ by less between the two than by what is not known of the experiment.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pandas as pd

from fileio.atomic import whole
from fileio.errors import StageError
from fileio.formats.bending_states import BendingStates, read
from pipeline.fea.finger import fit_circle
from pipeline.kinematics.pressure_law import stroke_law
from pipeline.structure.chain import Chain
from pipeline.structure.motion import STEP, Surroundings, at_rest, motion
from tests.studies.pages import libraries, write_between

ROOT = Path(__file__).resolve().parents[2]
STATES = ROOT / "cases" / "single_finger" / "kinematics" / "states.h5"
PAGE, TABLE = ROOT / "docs" / "coupling.md", ROOT / "docs" / "air_and_water.csv"
GRAVITY, WATER = 9.81, 998.2
CLOSING = {"added_mass": 0.87, "drag": 2.2}  # a fit to the closing stroke of a coupled run
AT_REST, MOVED = (10.0, 20.0, 30.0), (5.0, 10.0, 15.0, 20.0, 25.0, 30.0)  # kPa
FILLING = (
    0.2  # s: after which the chambers have 98 % of their pressure; not known of the experiment
)
REACHED = 0.02  # of the change of bend: what is left when the finger counts as there
END = 1.0  # s


@dataclass(frozen=True)
class Assumption:
    """What is not known of the experiment; the defaults are those of the scenes."""

    name: str
    air_turn_deg: float | None = (
        0.0  # the finger's direction in air against hanging; None: its weight is not in its plane
    )
    depth: float | None = (
        None  # m of water over its middle, where the pressure is measured against the atmosphere
    )
    stiffness: float = 1.0
    damping: float = 0.004  # s
    filling: float = FILLING  # s
    added_mass: float = CLOSING["added_mass"]
    drag: float = CLOSING["drag"]


ASSUMED = (
    Assumption("as in the scenes"),
    Assumption("in air lying, ventral side down", air_turn_deg=-90),
    Assumption("in air lying, ventral side up", air_turn_deg=90),
    Assumption("in air lying on its side", air_turn_deg=None),
    Assumption("in air upright", air_turn_deg=180),
    Assumption("pressure against the atmosphere, 0.2 m deep", depth=0.235),
    Assumption("pressure against the atmosphere, 0.055 m deep", depth=0.09),
    Assumption("stiffness +25 %", stiffness=1.25),
    Assumption("stiffness −20 %", stiffness=0.8),
    Assumption("damping of 15 ms", damping=0.015),
    Assumption("chambers full after 0.15 s", filling=0.15),
    Assumption("chambers full after 0.3 s", filling=0.3),
    Assumption("water's added mass +20 %", added_mass=1.2 * CLOSING["added_mass"]),
    Assumption("water's drag × 2", drag=2 * CLOSING["drag"]),
)


def chain_of(states: BendingStates, stiffness: float) -> Chain:
    """The shipped finger, its bending stiffness times a factor."""
    assert states.law is not None
    law = replace(
        states.law, stiffness=stiffness * states.law.stiffness, moment=stiffness * states.law.moment
    )
    return Chain(states, law, states.width)


def surroundings(given: Assumption, water: bool) -> Surroundings:
    """In water hanging, as in the tank; in air as assumed."""
    if water:
        return Surroundings(GRAVITY, WATER, given.added_mass, given.drag, given.damping)
    weight = (
        0.0 if given.air_turn_deg is None else GRAVITY * np.exp(1j * np.radians(given.air_turn_deg))
    )
    return Surroundings(weight, damping=given.damping)


def inner(pressure: float, given: Assumption, water: bool) -> float:
    """Pressure (Pa) of the chambers against what is outside, of a reading of `pressure` kPa."""
    outside = WATER * GRAVITY * given.depth if water and given.depth else 0.0
    return 1e3 * pressure - outside


def radius(chain: Chain, pressure: float, given: Assumption, water: bool) -> float:
    """R (m) at rest."""
    at = inner(pressure, given, water)
    delta = at_rest(chain, at, surroundings(given, water), np.zeros((chain.slices, 3)), parts=3)
    return fit_circle(chain.profile(np.array([at]), delta[None])[0])[0]


def actuation_time(
    chain: Chain, pressure: float, given: Assumption, water: bool
) -> tuple[float, float]:
    """Times (s) from the valve's opening at which the bend first has 98 % of its change, and after which it stays within 10 %."""
    time = np.linspace(0, END, round(END / STEP) + 1)
    start, end = inner(0.0, given, water), inner(pressure, given, water)
    inside = stroke_law(start, [(end, 0.0, given.filling)])(time)
    delta = motion(
        chain, inside, STEP, surroundings(given, water), np.zeros((len(time), chain.slices, 3))
    )
    rest = at_rest(chain, end, surroundings(given, water), np.zeros((chain.slices, 3)), parts=3)
    last = chain.bend(np.array([end]), rest[None])[0]
    bend = chain.bend(inside, delta)
    left = (last - bend) / (last - bend[0])
    there, outside = left <= REACHED, np.abs(left) > 0.1
    if not there.any():
        raise StageError(f"{given.name}: the finger is not there after {END} s; raise END")
    return float(time[np.argmax(there)]), float(time[len(time) - 1 - np.argmax(outside[::-1])])


def study() -> pd.DataFrame:
    """All assumptions: R at AT_REST, times at MOVED as they are assumed, else at 20 kPa alone."""
    states, rows = read(STATES), []
    for number, given in enumerate(ASSUMED):
        chain = chain_of(states, given.stiffness)
        for water in (False, True):
            about = {"assumption": given.name, "medium": "water" if water else "air"}
            for pressure in AT_REST:
                rows.append(
                    about
                    | {"pressure_kpa": pressure, "radius_m": radius(chain, pressure, given, water)}
                )
            for pressure in MOVED if number == 0 else (20.0,):
                first, settled = actuation_time(chain, pressure, given, water)
                rows.append(
                    about
                    | {"pressure_kpa": pressure, "time_98_s": first, "time_settled_s": settled}
                )
        print(f"air and water: {given.name}", flush=True)
    return pd.DataFrame(rows)


def page(table: pd.DataFrame) -> str:
    """The tables and what they say, as Markdown."""
    by = table.pivot_table(index="assumption", columns=["medium", "pressure_kpa"], sort=False)
    lines = [
        "| assumption | R in air at 10, 20, 30 kPa, mm | in water | water above air, % | 98 % after, s at 20 kPa: air | water | within 10 % after, s: air | water |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for name in by.index:
        of = lambda what, medium, p, name=name: by.loc[name, (what, medium, p)]  # noqa: E731
        air, water = ([of("radius_m", m, p) for p in AT_REST] for m in ("air", "water"))
        cells = [
            ", ".join(f"{1e3 * r:.1f}" for r in air),
            ", ".join(f"{1e3 * r:.1f}" for r in water),
            ", ".join(f"{100 * (w / a - 1):+.1f}" for a, w in zip(air, water, strict=True)),
            *(
                f"{of(what, m, 20.0):.3f}"
                for what in ("time_98_s", "time_settled_s")
                for m in ("air", "water")
            ),
        ]
        lines.append(f"| {name} | " + " | ".join(cells) + " |")
    first = table[(table["assumption"] == ASSUMED[0].name) & table["time_98_s"].notna()]
    times = {m: first[first["medium"] == m]["time_98_s"].tolist() for m in ("air", "water")}
    said = "; ".join(
        f"{m} {', '.join(f'{t:.3f}' for t in values)} s" for m, values in times.items()
    )
    lines += [
        "",
        f"98 % at {', '.join(f'{p:g}' for p in MOVED)} kPa, as in the scenes: {said}. {libraries()}.",
    ]
    return "\n".join(lines)


def main() -> None:
    """Run the study and write its page and table."""
    table = study()
    with whole(TABLE) as part:
        table.to_csv(part, index=False, float_format="%.5g")
    write_between(PAGE, "air and water", page(table))


if __name__ == "__main__":
    main()
