"""The elastic chain against published numbers of other bodies: Turek and Hron's beam, Luhar and Nepf's blades in a current.

python -m tests.studies.elastic_benchmarks   (make elastic-benchmarks; writes docs/coupling.md between its marks)
Neither is a finger, and no number of the chain is fitted to them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from scipy.optimize import fsolve

from fileio.errors import StageError
from fileio.formats.bending_states import FloatArray, States
from pipeline.structure.chain import Chain, joint_moments, placed
from pipeline.structure.elastic_law import constant_law, law_at
from pipeline.structure.motion import Rates, Surroundings, at_rest, forces, motion
from tests.studies.pages import libraries, write_between

PAGE = Path(__file__).resolve().parents[2] / "docs" / "coupling.md"
AT_REST = np.zeros(1)  # Pa: a beam has one state


def beam(
    length: float, height: float, width: float, stiffness: float, pieces: int = 124, **law: Any
) -> Chain:
    """A straight beam (m, N m²) whose middle line is its profile and its neutral axis; `pieces`: four to a slice."""
    line = np.stack([np.linspace(0, length, pieces + 1), np.zeros(pieces + 1)], -1)
    states = States(
        np.array([-1e3, 0.0, 1e3]), np.repeat(line[None], 3, 0), np.full((3, pieces + 1), height)
    )
    given = constant_law(stiffness, 0.0, 3)
    return Chain(states, replace(given, **{"rubber_section": width * height} | law), width)


# Turek and Hron (2006), tests CSM1 to CSM3: an elastic beam under gravity, clamped at one end, in a plane (plane strain);
# https://wwwold.mathematik.tu-dortmund.de/~featflow/en/benchmarks/cfdbenchmarking/fsi_benchmark/fsi_tests/fsi_csm_tests.html
LENGTH, HEIGHT, DENSITY, POISSON, GRAVITY = 0.35, 0.02, 1000.0, 0.4, 2.0
YOUNG = {"CSM1": 1.4e6, "CSM2": 5.6e6, "CSM3": 1.4e6}  # Pa
TIP = {
    "CSM1": (-7.187e-3, -66.10e-3),
    "CSM2": (-0.4690e-3, -16.97e-3),
}  # m, of the beam's end, along and across
SWING = (-63.607e-3, 65.160e-3, 1.0995)  # CSM3 across: mean and amplitude, m, and frequency, Hz
PERIODS = 10  # of CSM3 that are computed


def turek_hron(name: str) -> Chain:
    """The beam of one test: a slice of 1 m, its bending stiffness that of plane strain."""
    stiffness = YOUNG[name] * HEIGHT**3 / 12 / (1 - POISSON**2)
    return beam(LENGTH, HEIGHT, 1.0, stiffness, rubber_mass=DENSITY * HEIGHT)


def at_rest_under_gravity(name: str) -> FloatArray:
    """Displacement (2,) m of the end."""
    chain = turek_hron(name)
    delta = at_rest(chain, 0.0, Surroundings(-1j * GRAVITY), np.zeros((chain.slices, 3)))
    return chain.profile(AT_REST, delta[None])[0, -1] - [LENGTH, 0.0]


def swing(step: float = 2.5e-3) -> tuple[float, float, float]:
    """CSM3: mean and amplitude (m) across, from the extremes over all periods, and the frequency (Hz); `step` s."""
    chain = turek_hron("CSM3")
    time = step * np.arange(round(PERIODS / SWING[2] / step) + 1)
    pressure, nothing = 0 * time, np.zeros((len(time), chain.slices, 3))
    delta = motion(
        chain, pressure, step, Surroundings(-1j * GRAVITY), nothing, np.zeros(chain.slices)
    )
    across = chain.profile(pressure, delta)[:, -1, 1]
    mean, amplitude = 0.5 * (across.max() + across.min()), 0.5 * float(np.ptp(across))
    passed = np.flatnonzero(np.diff(np.sign(across - mean)) < 0)
    at = time[passed] + step * (across[passed] - mean) / (across[passed] - across[passed + 1])
    return float(mean), amplitude, 1 / float(np.diff(at).mean())


# Luhar and Nepf, Limnol. Oceanogr. 56 (2011) 2003: blades that a current bends, confirmed there by drag and posture measured
# in a flume; the law of the effective length as vegetation modules of ocean models have it (ROMS, vegetation_drag.F).
DRAG, WATER, UP = 1.95, 1000.0, 9.81  # the flat plate's coefficient; kg/m³; m/s²
CAUCHY = (1.0, 3.0, 10.0, 30.0, 100.0, 300.0, 1000.0)
BUOYANCY = (0.0, 10.0, 100.0)
BLADE = {
    "length": 0.2,
    "height": 4e-4,
    "width": 0.01,
    "stiffness": 1e-4,
}  # m, N m²: of any size, the law has none


def effective_length(cauchy: float, buoyancy: float) -> float:
    """Length of an upright rigid blade of the same drag, over the blade's own; for Ca ≥ 1."""
    return 1 - (1 - 0.9 * cauchy ** (-1 / 3)) / (1 + cauchy**-1.5 * (8 + buoyancy**1.5))


@dataclass(frozen=True)
class Blade:
    """An upright blade in a horizontal current: Cauchy number ½ ρ C_D b U² l³/EI, buoyancy Δρ g b t l³/EI."""

    cauchy: float
    buoyancy: float

    def drag(self, guess: FloatArray | None) -> tuple[float, FloatArray]:
        """Drag over that of the upright blade by the chain and the modelled water, and its rotations; from a `guess` of these."""
        length, width, stiffness = BLADE["length"], BLADE["width"], BLADE["stiffness"]
        # without mass: what it displaces is its whole buoyancy
        section = self.buoyancy * stiffness / length**3 / (WATER * UP)
        chain = beam(**BLADE, pieces=248, rubber_section=section)
        speed = np.sqrt(self.cauchy * stiffness / (0.5 * WATER * DRAG * width * length**3))
        law, unloaded = law_at(chain.law, chain.pressure, 0.0), chain.unloaded(AT_REST)
        none = np.zeros(chain.slices)
        # water that flows past a blade at rest is a blade that moves against water at rest
        rates = Rates(none - 1j * speed, none + 0j, none + 0j, none + 0j)
        around = Surroundings(-UP, WATER, drag=DRAG)

        def unbalanced(delta: FloatArray) -> FloatArray:
            at = placed(unloaded, 0, delta)
            acting = forces(
                chain, around, at, rates, chain.air_section(AT_REST), np.zeros((chain.slices, 3))
            )
            return law.moment(np.diff(delta, prepend=0.0) / chain.springs) - joint_moments(
                at, acting, none
            )

        delta, _, found, why = fsolve(
            unbalanced, none if guess is None else guess, full_output=True
        )
        if found != 1:
            raise StageError(f"blade at Ca = {self.cauchy:g}, B = {self.buoyancy:g}: {why}")
        at = placed(unloaded, 0, delta)
        push = forces(
            chain, around, at, rates, chain.air_section(AT_REST), np.zeros((chain.slices, 3))
        )[-1][1]
        return float(push.imag.sum() / (0.5 * WATER * DRAG * width * speed**2 * length)), delta


def blades() -> pd.DataFrame:
    """Effective lengths by the chain and as published."""
    rows = []
    for buoyancy in BUOYANCY:
        delta = None
        for cauchy in CAUCHY:
            value, delta = Blade(cauchy, buoyancy).drag(delta)
            published = effective_length(cauchy, buoyancy)
            rows.append(
                {"buoyancy": buoyancy, "cauchy": cauchy, "chain": value, "published": published}
            )
    return pd.DataFrame(rows)


def page() -> str:
    """Both tables as Markdown."""
    lines = ["| test | | published | chain | difference |", "|---|---|---|---|---|"]

    def row(test: str, what: str, published: float, value: float, digits: int) -> str:
        return f"| {test} | {what} | {published:.{digits}f} | {value:.{digits}f} | {100 * (value / published - 1):+.1f} % |"

    for name, values in TIP.items():
        found = at_rest_under_gravity(name)
        lines += [
            row(name, f"end {way}, mm", 1e3 * known, 1e3 * got, 2)
            for way, known, got in zip(("along", "across"), values, found, strict=True)
        ]
    names = ("mean across, mm", "amplitude across, mm", "frequency, Hz")
    for what, known, got, factor in zip(names, SWING, swing(), (1e3, 1e3, 1.0), strict=True):
        lines.append(row("CSM3", what, factor * known, factor * got, 4 if factor == 1 else 2))
    table = blades()
    lines += [
        "",
        "| effective length, chain (published), at Ca = | "
        + " | ".join(f"{c:g}" for c in CAUCHY)
        + " |",
        "|---|" + "---|" * len(CAUCHY),
    ]
    for buoyancy, part in table.groupby("buoyancy"):
        cells = [f"{r.chain:.3f} ({r.published:.3f})" for r in part.itertuples()]
        lines.append(f"| B = {buoyancy:g} | " + " | ".join(cells) + " |")
    off = 100 * (table["chain"] / table["published"] - 1)
    lines += [
        "",
        f"Largest difference {off.loc[off.abs().idxmax()]:+.1f} %, RMS {np.sqrt((off**2).mean()):.1f} %. {libraries()}.",
    ]
    return "\n".join(lines)


def main() -> None:
    """Write the page's tables."""
    write_between(PAGE, "published numbers", page())


if __name__ == "__main__":
    main()
