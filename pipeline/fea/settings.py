"""The sections `[actuator]`, `[actuator.materials.*]` and `[fea]` of a scene."""

from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, model_validator

from pipeline.fea.silicones import material_of

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
# m; an actuator of a metre is millimetres misread
Length = Annotated[float, Field(gt=0, lt=1, allow_inf_nan=False)]
Count = Annotated[int, Field(ge=1)]
_Elements = Annotated[Count, Field(le=20)]  # along one dimension
_MOST_STATES = 1000
# at which six more analyses find the uncertainty
UNCERTAIN_AT_KPA = (-40.0, -30.0, -20.0, -15.0, -10.0, -5.0, 5.0, 10.0, 15.0, 20.0, 30.0, 40.0)


class _Frozen(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class Material(_Frozen):
    """A nearly incompressible hyperelastic law by its FElupe name."""

    law: str
    """Name of a hyperelastic law of FElupe"""
    parameters: dict[str, float | list[float]]
    """Of the law by FElupe's names, stresses [Pa]"""
    bulk: Positive
    """Bulk modulus [Pa]"""
    density: Positive = 1080.0
    """Of the rubber; that of Dragon Skin 30 by its data sheet [kg/m³]"""
    name: str = ""
    """For people"""
    material: str | None = None
    """A silicone of the table in docs/fea.md, in place of law, parameters, bulk and density"""

    @model_validator(mode="before")
    @classmethod
    def _of_table(cls, keys: Any) -> Any:
        named = isinstance(keys, dict) and keys.get("material") is not None
        return keys | material_of(keys["material"]) if named else keys

    def number(self, key: str) -> float:
        """A parameter that is one number; raises ValueError."""
        value = self.parameters.get(key)
        if not isinstance(value, float):
            raise ValueError(
                f"law = {self.law!r} needs the number parameters.{key}, got {value!r}: add it"
            )
        return value


class _Materials(_Frozen):
    upper: Material
    """Of the chambers"""
    lower: Material
    """Of the base layer"""


class Actuator(_Frozen):
    """Geometry of the bidirectional actuator (paper, Fig. 2), in m, by the paper's names."""

    chambers: Annotated[Count, Field(le=50)]
    """n, number of chambers"""
    wedge_deg: Annotated[float, Field(ge=0, le=45)]
    """θ, of the chambers' upper part [deg]"""
    width: Length
    """W, outer [m]"""
    h1: Length
    """Height of the cavity [m]"""
    h2: Length
    """Height of the cavity's rectangular bottom [m]"""
    l1: Length
    """Wall between a cavity and the gap [m]"""
    l2: Length
    """Length of the cavity [m]"""
    gap: Length
    """Between the outer walls of neighbouring chambers [m]"""
    b1: Length
    """Side wall [m]"""
    b2: Length
    """Base layer [m]"""
    roof: Length
    """Above the cavity and above the air channel; not given by the paper [m]"""
    channel: Length
    """Height of the air channel between chambers; not given by the paper [m]"""
    materials: _Materials
    """Of the two layers"""
    material: str | None = None
    """A silicone of the table in docs/fea.md, for both layers"""

    @model_validator(mode="before")
    @classmethod
    def _one_material(cls, keys: Any) -> Any:
        if not isinstance(keys, dict) or keys.get("material") is None:
            return keys
        layer = {"material": keys["material"]}
        return keys | {"materials": {"upper": layer, "lower": layer}}

    @model_validator(mode="after")
    def _sensible(self) -> "Actuator":
        if self.h2 >= self.h1:
            raise ValueError(
                f"h2 = {self.h2} m must be below h1 = {self.h1} m:"
                " it is the rectangular part of the cavity"
            )
        if self.bridge >= self.h2:
            raise ValueError(
                f"channel + roof = {self.bridge} m must be below h2 = {self.h2} m:"
                " the gap between chambers needs a depth"
            )
        if 2 * self.b1 >= self.width:
            raise ValueError(
                f"width = {self.width} m leaves no cavity between two side walls of"
                f" b1 = {self.b1} m: give a larger width"
            )
        return self

    @property
    def bridge(self) -> float:
        """Height (m) of the air channel and its roof, which join two chambers."""
        return self.channel + self.roof

    @property
    def pitch(self) -> float:
        return self.l2 + 2 * self.l1 + self.gap

    @property
    def length(self) -> float:
        """From the first chamber's outer wall to the last one's, m."""
        return self.chambers * self.pitch - self.gap


class UnitCellMesh(_Frozen):
    """Numbers of second-order elements of the unit cell over each dimension."""

    cavity: _Elements = 2
    """Elements over half the cavity's length"""
    wall: _Elements = 1
    """Elements over l1, b1 and roof"""
    gap: _Elements = 1
    """Elements over half the gap"""
    base: _Elements = 1
    """Elements over b2"""
    bridge: _Elements = 1
    """Elements over the air channel and its roof"""
    side: _Elements = 2
    """Elements from the bridge up to h2"""
    wedge: _Elements = 1
    """Elements from h2 up to h1"""
    span: _Elements = 3
    """Elements over half the cavity's width"""

    def refined(self, factor: float) -> "UnitCellMesh":
        """The same with every number of elements multiplied."""
        return self.model_copy(
            update={k: max(1, round(v * factor)) for k, v in self.model_dump().items()}
        )


_Axis = Literal["x", "-x", "y", "-y", "z", "-z"]


class Import(_Frozen):
    """The user's own results, and their frame and unit (docs/fea.md)."""

    file: Path
    """.csv, .pvd, .vtu or .xdmf, relative to the scene"""
    unit: Literal["m", "mm"] = "m"
    """Of the file's lengths"""
    along: _Axis = "x"
    """Axis from the root to the tip"""
    ventral: _Axis = "y"
    """Axis from the chambers to the lower layer"""
    sheet: float = 0.0
    """The plane across in which the profile is taken [m]"""
    displacement_field: str = "displacement"
    """Its name in a .vtu or .xdmf"""
    pressures_kpa: list[float] | None = None
    """One for each state, where the file has none [kPa]"""
    kpa_per_time: float = 1.0
    """Else pressure = kpa_per_time × the time of the analysis [kPa]"""
    thickness: Length | None = None
    """Of profiles that come without [m]"""
    pitch: Length | None = None
    """Of the chambers, to smooth their ripple [m]"""

    @property
    def metres_per_unit(self) -> float:
        return 1e-3 if self.unit == "mm" else 1.0


class Fea(_Frozen):
    """How the analysis is run."""

    engine: Literal["unit_cell", "import"] = "unit_cell"
    """How bending is found"""
    first_pressure_kpa: Annotated[float, Field(ge=-90, le=500)] = -40.0
    """Of the states [kPa]"""
    last_pressure_kpa: Annotated[float, Field(ge=-90, le=500)] = 40.0
    """Of the states [kPa]"""
    pressure_step_kpa: Positive = 1.0
    """Between states [kPa]"""
    mesh: UnitCellMesh = UnitCellMesh()
    """Elements of the unit cell"""
    results: Import | None = None
    """The user's own results, for engine = "import" """
    uncertainty: bool = True
    """Whether six more analyses give the uncertainty of the radius"""
    under_load: bool = True
    """Whether the states say how the finger bends under a moment, and what it weighs"""
    partial: bool = False
    """Whether the states that converge are kept where others do not"""

    @model_validator(mode="after")
    def _three_states(self) -> "Fea":
        span = self.last_pressure_kpa - self.first_pressure_kpa
        if not 2 <= round(span / self.pressure_step_kpa) <= _MOST_STATES:
            raise ValueError(
                "first_pressure_kpa to last_pressure_kpa by pressure_step_kpa ="
                f" {self.pressure_step_kpa:g} gives fewer than three or more than {_MOST_STATES}"
                f" states: give a step from {span / _MOST_STATES:g} to {span / 2:g}"
            )
        if (self.engine == "import") != (self.results is not None):
            raise ValueError(
                'engine = "import" and the section [fea.results] belong together:'
                " give both or neither"
            )
        if self.partial and self.uncertainty:
            raise ValueError(
                "partial = true goes with uncertainty = false:"
                " a variation may end sooner than the states"
            )
        return self

    @property
    def pressures(self) -> NDArray[np.float64]:
        """Ascending pressures (Pa) of the states."""
        steps = round((self.last_pressure_kpa - self.first_pressure_kpa) / self.pressure_step_kpa)
        return 1e3 * np.linspace(self.first_pressure_kpa, self.last_pressure_kpa, max(steps, 0) + 1)
