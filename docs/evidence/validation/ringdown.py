"""A beam of Dragon Skin 10 that is let go: modulus and loss factor by the fit of the twin.

Recordings of Dubied et al. (arXiv 2201.12560, github.com/srl-ethz/diffPD_sim2real), which are not
part of the project: a beam of 30 x 30 x 100 mm, clamped, lifted, with masses of 0, 52 and
101 g at its end. Their own fit has E = 263.8 kPa.
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from docs.evidence.small_scene import shared_data
from docs.evidence.validation.checks import Check, Result
from pipeline.formats.bending_states import States
from pipeline.structure.chain import Chain
from pipeline.structure.elastic_law import constant_law
from pipeline.structure.motion import Surroundings, at_rest, motion
from pipeline.structure.vibration import slowness
from softfinger.twin.fit import Fit, Parameter, fit

MODULUS, DENSITY, SIDE, LENGTH = 263.8e3, 1070.0, 0.030, 0.100  # published: Pa, kg/m³; m
GRAVITY, STEP, SLICES, END = 9.81, 2e-3, 10, 1.2  # m/s²; s; 1; s after the release
END_SLICE = 0.002  # m
NAME = "ringdown"
NAMES = ("gravity", "load52", "load101")
GRAMS = {"gravity": 0.0, "load52": 52.0, "load101": 101.0}
MASS, RELEASE = "tip mass of {}", "release of {} {}"
LAST, NOISE = 1.2, 0.5e-3  # s of the file; m
FITTED, HELD_OUT = "a", "b"  # of the two recordings of each mass


def beam(modulus: float, tip_mass: float) -> Chain:
    """The beam with a mass (kg) in its last slice, a short one; `modulus` in Pa."""
    points = 4 * SLICES + 1
    along = np.linspace(0, LENGTH - END_SLICE, points - 4)
    along = np.append(along, np.linspace(LENGTH - END_SLICE, LENGTH, 5)[1:])
    line = np.stack([along, np.zeros(points)], -1)
    states = States(
        np.array([-1e3, 0.0, 1e3]), np.repeat(line[None], 3, 0), np.full((3, points), SIDE)
    )
    mass = np.full(SLICES, DENSITY * SIDE**2)
    mass[-1] += tip_mass / END_SLICE
    sizes: dict[str, Any] = {"rubber_section": SIDE**2, "rubber_mass": mass}  # one for each slice
    return Chain(states, replace(constant_law(modulus * SIDE**4 / 12, 0.0, 3), **sizes), SIDE)


@lru_cache(maxsize=64)
def decay(modulus: float, loss_factor: float, tip_mass: float, start: float) -> np.ndarray:
    """Place of the tip (m) against its rest, `STEP` s apart, of a beam that is let go at `start`.

    It is then in the shape of its sag, so many times as deep.
    """
    chain = beam(modulus, tip_mass)
    lag = loss_factor * slowness(chain, 0.0, Surroundings())
    around, none = Surroundings(-1j * GRAVITY, damping=lag), np.zeros((chain.slices, 3))
    count = round(END / STEP) + 1
    pressure = np.zeros(count)
    rest = at_rest(chain, 0.0, around, none)
    still = chain.profile(pressure[:1], rest[None])[0, -1, 1]
    turned = motion(
        chain, pressure, STEP, around, np.broadcast_to(none, (count, *none.shape)),
        rest * (1 + start / still),
    )  # fmt: skip
    tip = chain.profile(pressure, turned)[:, -1, 1]
    return np.asarray(tip - still)


def read(folder: Path, name: str, which: str) -> tuple[np.ndarray, np.ndarray]:
    """Time (s) and place of the tip (m) of a recording, from the start of its file on."""
    table = pd.read_csv(folder / f"beam_{name}_V2_{which}.csv")
    return table["t_s"].to_numpy(), table["tip_m"].to_numpy()


def modelled(
    values: dict[str, float], name: str, which: str, time: np.ndarray, start: float
) -> np.ndarray:
    """Place of the tip (m) by the beam's parameters, and the release's instant and place (m)."""
    mass = GRAMS[name] / 1e3 * values.get(MASS.format(name), 1.0)
    run = decay(values["modulus"], values["loss factor"], round(mass, 9), start)
    return np.interp(time - values[RELEASE.format(name, which)], STEP * np.arange(len(run)), run)


def parameters() -> list[Parameter]:
    """Modulus, loss factor, tip masses and instants of release with their priors.

    Of the masses the files' names alone are known, and that they are not points at the end.
    """
    return [
        Parameter("modulus", 259e3, 0.3, "Pa", ratio=True),
        Parameter("loss factor", 0.12, 0.5, "", ratio=True),
        *(Parameter(MASS.format(n), 1.0, 0.05, "", ratio=True) for n in NAMES if GRAMS[n]),
        *(Parameter(RELEASE.format(n, FITTED), 0.1, 0.02, "s") for n in NAMES),
    ]


def identified(folder: Path) -> Fit:
    """The fit to the first recording of each mass."""
    data = {name: read(folder, name, FITTED) for name in NAMES}

    def residuals(values: dict[str, float]) -> list[np.ndarray]:
        return [
            (modelled(values, name, FITTED, time, place[0]) - place)[time < LAST][:, None]
            for name, (time, place) in data.items()
        ]

    return fit(parameters(), residuals, NOISE)


def held_out(folder: Path, found: Fit) -> dict[str, float]:
    """RMS distance of the tip over the beam's length in the second recording of each mass.

    The least over instants of release, which are not known.
    """
    out = {}
    for name in NAMES:
        time, place = read(folder, name, HELD_OUT)
        off = [
            np.sqrt(np.mean((modelled(found.values() | {RELEASE.format(name, HELD_OUT): at}, name,
                                      HELD_OUT, time, place[0]) - place)[time < LAST] ** 2))
            for at in np.arange(0.05, 0.15, 1e-3)
        ]  # fmt: skip
        out[name] = float(min(off)) / LENGTH
    return out


def measure() -> Result | None:
    """Modulus, damping and held-out decays; None where the recordings are not there."""
    shared = shared_data()
    if shared is None:
        return None
    folder = shared / "silicone_ringdown"
    found = identified(folder)
    values, off = found.values(), held_out(folder, found)
    published = "Dubied et al., arXiv 2201.12560"
    evaluated = pd.read_csv(folder / "evaluated.csv")["loss_factor"]
    checks = (
        Check("ringdown.modulus", "Young's modulus", values["modulus"], 0.05, "relative",
              "the published fit is of Euler and Bernoulli's beam without its masses' size",
              MODULUS, published, "Pa"),
        Check("ringdown.loss", "loss factor", values["loss factor"],
              float(np.ptp(evaluated)) / 2, "absolute",
              "within those of the recordings' windows, evaluated decay by decay",
              float(evaluated.min() + evaluated.max()) / 2, published),
        *(Check(f"ringdown.{name}", f"tip in the held-out decay with {GRAMS[name]:g} g, RMS over"
                " the length", value, 0.03, "at most", "what published twins reach: 3 to 5 %")
          for name, value in off.items()),
    )  # fmt: skip
    return Result(NAME, "A silicone beam that is let go", checks)
