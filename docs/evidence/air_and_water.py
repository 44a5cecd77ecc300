"""The paper's Fig. 9 by the chain: bending radius and times in air and in water.

    python -m docs.evidence.air_and_water

varies what is not known of the experiment, and writes docs/record/air_and_water_table.csv. Water is
the modelled one, the damping that of the default loss factor. It takes three minutes of CPU time.
"""

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pandas as pd

from docs.evidence.small_scene import ROOT
from pipeline.fea.finger import fit_circle
from pipeline.formats.bending_states import BendingStates, read_states
from pipeline.kinematics.pressure_law import stroke_law
from pipeline.scene.scene import Scene, load_scene
from pipeline.structure.finger import ElasticFinger
from pipeline.structure.motion import STEP, Surroundings, at_rest, motion
from pipeline.structure.vibration import slowness
from postprocess.tables import write_table

_SCENE = ROOT / "cases" / "single_finger"
_AT_REST, _MOVED = (10.0, 20.0, 30.0), 20.0  # kPa
_FILLING = 0.2  # s, not known of the experiment
_END = 1.0  # s
_STIFFNESS = ("stiffness", "moment")  # of the bending law


@dataclass(frozen=True)
class Assumption:
    """What is not known of the experiment; the defaults are those of the scenes.

    `turned_deg`: the finger in air against hanging; None: its weight acts across its plane.
    `depth`: m of water over its middle, where the pressure was measured against the atmosphere.
    `filling`: s. `model`: factors on the numbers of the modelled water.
    """

    name: str
    turned_deg: float | None = 0.0
    depth: float = 0.0
    stiffness: float = 1.0
    loss_factor: float | None = None
    filling: float = _FILLING
    model: dict[str, float] = field(default_factory=dict)


ASSUMED = (
    Assumption("as in the scenes"),
    Assumption("in air lying, ventral side down", turned_deg=-90),
    Assumption("in air lying, ventral side up", turned_deg=90),
    Assumption("in air lying on its side", turned_deg=None),
    Assumption("in air upright", turned_deg=180),
    Assumption("pressure against the atmosphere, 0.2 m deep", depth=0.235),
    Assumption("pressure against the atmosphere, 0.055 m deep", depth=0.09),
    Assumption("stiffness +25 %", stiffness=1.25),
    Assumption("stiffness −20 %", stiffness=0.8),
    Assumption("loss factor 0.10", loss_factor=0.10),
    Assumption("loss factor 0.15", loss_factor=0.15),
    Assumption("loss factor 0.34, which recordings exclude", loss_factor=0.34),
    Assumption("chambers full after 0.15 s", filling=0.15),
    Assumption("chambers full after 0.3 s", filling=0.3),
    Assumption("water's added mass +20 %", model={"added_mass": 1.2}),
    Assumption("water's drag × 2", model={"drag": 2.0}),
)


class Medium:
    """The shipped finger in air or water, under an assumption."""

    def __init__(self, scene: Scene, given: Assumption, water: bool) -> None:
        states = read_states(scene.folder / str(scene.motion.states), scene.finger.thickness)
        assert isinstance(states, BendingStates)
        assert states.law is not None
        stiffer = {name: given.stiffness * getattr(states.law, name) for name in _STIFFNESS}
        finger = ElasticFinger.of(scene, replace(states, law=replace(states.law, **stiffer)))
        self.chain = finger.chain
        self._outside = water * scene.fluid.density * 9.81 * given.depth
        self._filling = given.filling
        around = finger.model if water else finger.air
        if water:
            changes = {name: by * getattr(around, name) for name, by in given.model.items()}
        else:
            turn = 0.0 if given.turned_deg is None else np.exp(1j * np.radians(given.turned_deg))
            changes = {"gravity": turn * around.gravity}
        around = replace(around, **changes)
        loss = scene.structure.loss_factor if given.loss_factor is None else given.loss_factor
        slow = slowness(self.chain, 1e3 * _MOVED, replace(around, damping=0.0))
        self._around: Surroundings = replace(around, damping=loss * slow)

    def _rest(self, kpa: float) -> tuple[float, np.ndarray]:
        inside = 1e3 * kpa - self._outside
        return inside, at_rest(self.chain, inside, self._around, np.zeros((self.chain.slices, 3)))

    def radius(self, kpa: float) -> float:
        """Bending radius (m) at rest."""
        inside, delta = self._rest(kpa)
        return float(fit_circle(self.chain.profile(np.array([inside]), delta[None])[0])[0])

    def times(self, kpa: float) -> tuple[float, float]:
        """When the bend first has 98 % of its change, and from when it stays within 10 %, s."""
        time = np.linspace(0, _END, round(_END / STEP) + 1)
        start, (end, rest) = -self._outside, self._rest(kpa)
        inside = stroke_law(start, [(end, 0.0, self._filling)])(time)
        none = np.zeros((len(time), self.chain.slices, 3))
        bend = self.chain.bend(inside, motion(self.chain, inside, STEP, self._around, none))
        last = self.chain.bend(np.array([end]), rest[None])[0]
        left = (last - bend) / (last - bend[0])
        far = np.flatnonzero(np.abs(left) > 0.1)
        return float(time[np.argmax(left <= 0.02)]), float(time[far[-1]])


def row(scene: Scene, given: Assumption) -> dict[str, Any]:
    """An assumption's numbers in air and in water."""
    air, water = (Medium(scene, given, wet) for wet in (False, True))
    radii = [[one.radius(kpa) for kpa in _AT_REST] for one in (air, water)]
    (first_air, last_air), (first_water, last_water) = air.times(_MOVED), water.times(_MOVED)
    above = (f"{100 * (w / a - 1):+.1f}" for a, w in zip(*radii, strict=True))
    return {
        "assumption": given.name,
        "R in air at 10, 20, 30 kPa, mm": ", ".join(f"{1e3 * r:.1f}" for r in radii[0]),
        "in water": ", ".join(f"{1e3 * r:.1f}" for r in radii[1]),
        "water above air, %": ", ".join(above),
        "98 % after, s at 20 kPa: air": f"{first_air:.3f}",
        "water, 98 %": f"{first_water:.3f}",
        "within 10 % after, s: air": f"{last_air:.3f}",
        "water, within 10 %": f"{last_water:.3f}",
    }


def main() -> None:
    """Write the table."""
    scene = load_scene(_SCENE)
    table = pd.DataFrame([row(scene, given) for given in ASSUMED])
    write_table(ROOT / "docs" / "record" / "air_and_water_table.csv", table)
    print(table.to_string())


if __name__ == "__main__":
    main()
