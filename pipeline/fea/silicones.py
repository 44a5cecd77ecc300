"""Common silicones by name: a law, its parameters, density, source and range of strain.

A data sheet's stress at 100 % of tension makes a neo-Hookean law: nominal stress μ (λ − 1 / λ²),
thus μ = stress / 1.75. Dragon Skin 10 has then E = 3 μ = 259 kPa, and 264 kPa as a beam (Dubied et
al., arXiv 2201.12560). Batches, mixing and cure change a silicone by tens of percent: in tensile
tests (Maréchal et al., Soft Robotics 8:284, 2021, and its database) the stress at 100 % of tension
is 0.27 to 0.49 of the data sheet's for Ecoflex and 0.74 to 0.94 of it for Dragon Skin.

The data sheets state psi: 8, 10, 12 (Ecoflex), 22, 49, 86 (Dragon Skin) and 272 (Smooth-Sil 950).
All were compared with a second statement in 2026: a published table of these silicones, the
abstract of Johnston et al., a model that quotes Polygerinos' coefficients, and for Smooth-Sil 950 a
law that was fitted by others (C10 = 261, C01 = 98, C20 = 57.5 kPa; 1888 kPa at 100 %, 1211 kg/m³).
"""

from typing import Any, NamedTuple

from piv.files.errors import suggestion

_AT_DOUBLE = 2 - 1 / 2**2  # λ − 1 / λ² at 100 % of tension
_BULK = 50.0  # times the shear modulus: Poisson's ratio 0.49, as Dragon Skin 30 of the paper
_SHEET = "data sheet of Smooth-On: stress at 100 %"


class Silicone(NamedTuple):
    """A law with parameters in Pa by FElupe's names; `strain`: largest tension of the source."""

    law: str
    parameters: dict[str, float]
    density: float  # kg/m³
    strain: float
    source: str

    @property
    def shear_modulus(self) -> float:
        """Shear modulus at small strains, Pa."""
        return self.parameters.get("mu", 2 * self.parameters.get("C10", 0.0))


def _smooth_on(stress_kpa: float, density: float) -> Silicone:
    return Silicone("neo_hooke", {"mu": 1e3 * stress_kpa / _AT_DOUBLE}, density, 1.0, _SHEET)


SILICONES = {
    "Ecoflex 00-10": _smooth_on(55, 1040),
    "Ecoflex 00-30": _smooth_on(69, 1070),
    "Ecoflex 00-50": _smooth_on(83, 1070),
    "Dragon Skin 10": _smooth_on(151, 1070),
    "Dragon Skin 20": _smooth_on(338, 1080),
    "Dragon Skin 30": _smooth_on(593, 1080),
    "Smooth-Sil 950": _smooth_on(1876, 1240),
    "Elastosil M4601": Silicone(
        "yeoh", {"C10": 0.11e6, "C20": 0.02e6, "C30": 0.0}, 1130, 1.5,
        "Polygerinos et al., IROS 2013; density: data sheet of Wacker",
    ),
    "Sylgard 184": Silicone(
        "neo_hooke", {"mu": 1.32e6 / 3}, 1030, 0.4,
        "cured at 25 °C: Johnston et al., J. Micromech. Microeng. 24:035017, 2014",
    ),
}  # fmt: skip


def material_of(name: str) -> dict[str, Any]:
    """The keys of a material by its name; raises ValueError."""
    if name not in SILICONES:
        raise ValueError(
            f"material = {name!r} is not known{suggestion(name, SILICONES)}: choose one of"
            f" {', '.join(SILICONES)}, or give law and parameters"
        )
    found = SILICONES[name]
    return {
        "law": found.law,
        "parameters": found.parameters,
        "bulk": _BULK * found.shear_modulus,
        "density": found.density,
        "name": name,
    }
