"""The sections of a scene.toml: tank, fluid, finger, motion, mesh, model and numerics."""

from __future__ import annotations

from itertools import pairwise
from typing import Annotated, Literal

from pydantic import Field, model_validator

from pipeline.scene.rigid_body import Law
from pipeline.scene.section import Count, NotNegative, Number, Pair, Positive, Section, Whole


class Tank(Section):
    """Inner size (x, y up, z) and water depth, m; origin at the centre of the bottom."""

    size: tuple[Positive, Positive, Positive] = (0.600, 0.330, 0.300)
    water_depth: Positive = 0.300


class Fluid(Section):
    """Water, and what is modelled of its turbulence."""

    density: Positive = 998.2
    kinematic_viscosity: Positive = 1.004e-6
    turbulence: Literal["laminar", "WALE"] = "laminar"


class Tip(Section):
    """End of the finger: a straight, tapered extension and rounded corners, m."""

    length: NotNegative = 0.0
    thickness: Positive | None = None
    corner_radius: Positive = 0.002

    @model_validator(mode="after")
    def _taper_has_length(self) -> Tip:
        if self.thickness is not None and self.length == 0:
            raise ValueError("a thickness is given but no length to taper over; give finger.tip.length")
        return self


class Finger(Section):
    """Pose and envelope, m; `root` is the middle of the root in the tank frame.

    Of a pinch it is finger 0, the left one: `root` in scene.toml says x = 0, the loaded scene -pinch.half_distance.
    """

    root: Pair
    length: Positive = 0.070
    thickness: Positive = 0.0145
    width: Positive = 0.028
    root_corner_radius: Positive = 0.002
    tilt_deg: Annotated[Number, Field(ge=-60, le=60)] = 0.0  # about the root, counter-clockwise
    ventral: Literal["+x", "-x"] = "+x"
    tip: Tip = Tip()


Pressure = Annotated[Number, Field(ge=-100, le=500)]  # kPa: no less than a vacuum


class Segment(Section):
    """One stroke of a motion: go to `pressure_kpa` from `start` on, 2 % settled after `duration`, s."""

    pressure_kpa: Pressure
    start: NotNegative
    duration: Positive


class Motion(Section):
    """Where shapes and the pressure history come from."""

    source: Literal["fea", "paper_equations", "recording", "rigid"] = "paper_equations"
    states: str | None = None
    recording: str | None = None  # of source "recording": motion as a camera saw it (docs/formats.md)
    recording_factor: Annotated[Positive, Field(le=10)] = (
        1.0  # on its bending, to measure what an error of it does
    )
    start_pressure_kpa: Pressure = 0.0
    strokes: tuple[Segment, ...] = ()
    pressure_csv: str | None = None
    end_time: Positive
    max_bend_step_deg: Annotated[Positive, Field(ge=0.1, le=30)] = 5.0

    displacement: Law | None = None  # of a rigid body, m
    rotation: Law | None = None  # of a rigid body, deg
    path_step: Positive | None = None  # distance (m, or rad) of a rigid body between two shapes of the mesh

    @model_validator(mode="after")
    def _one_history(self) -> Motion:
        rigid = (self.displacement is not None) + (self.rotation is not None)
        if rigid != (self.source == "rigid") or (rigid and (self.strokes or self.pressure_csv)):
            raise ValueError(
                "motion.source = 'rigid' takes either motion.displacement or motion.rotation and nothing else"
            )
        if rigid:
            unused = {"states", "recording", "recording_factor", "start_pressure_kpa", "max_bend_step_deg"}
            if given := sorted(unused & self.model_fields_set):
                raise ValueError(f"motion.{given[0]} is a finger's; remove it beside motion.source = 'rigid'")
            return self
        if self.path_step:
            raise ValueError("motion.path_step is a rigid body's; give motion.max_bend_step_deg for a finger")
        if self.source == "recording":
            if not self.recording or self.strokes or self.pressure_csv:
                raise ValueError(
                    "motion.source = 'recording' needs motion.recording, the path of a motion.h5, and no strokes (strokes = [])"
                    " and no pressure_csv beside it"
                )
            return self
        if self.recording or self.recording_factor != 1:
            raise ValueError(
                "motion.recording and recording_factor belong to motion.source = 'recording'; remove them"
            )
        if bool(self.strokes) == bool(self.pressure_csv):
            raise ValueError("give either motion.strokes or motion.pressure_csv, not both and not neither")
        if self.pressure_csv and self.start_pressure_kpa != 0:
            raise ValueError(
                "motion.start_pressure_kpa belongs to motion.strokes; remove it beside motion.pressure_csv"
            )
        if any(b.start <= a.start for a, b in pairwise(self.strokes)):
            raise ValueError("motion.strokes must start one after the other; sort them by start")
        if self.source == "fea" and not self.states:
            raise ValueError("motion.source = 'fea' needs motion.states, the path of a states.h5 or CSV")
        return self


class Structure(Section):
    """How the finger answers loads, where the bending analysis does not say: EI (N m²), for all pressures."""

    bending_stiffness: Positive | None = None


FINGER_LENGTH = 0.070  # m: that of a finger whose defaults are not scaled
SCALED = ("near_distance", "tip_distance", "tip_transition", "wall_distance", "jet_reach")  # of [mesh]


class Mesh(Section):
    """Planform and sweep: target cell sizes and layers, m.

    Defaults of `SCALED` are those of a finger of 70 mm; a scene with another, or with a rigid body, scales them with its size.
    """

    wall_cell: Positive
    wall_first_layer: Positive
    wall_layers: Annotated[Count, Field(le=40)]
    wall_growth: Annotated[Number, Field(ge=1, le=2)] = 1.3
    wall_distance: Positive = 0.002  # within which triangles are as small as at the wall
    tip_cell: Positive
    tip_distance: Positive = 0.012  # from the tip along the wall: cells of tip_cell
    tip_transition: Positive = 0.02  # over which they grow from there to wall_cell
    near_cell: Positive
    near_distance: Positive = 0.045
    far_cell: Positive
    edge_layer: Positive = 1.0e-3  # of the sweep, on both sides of the finger's side edge
    sheet_layer: Positive = 2.3e-3  # most between the side edges: what the sheet's vortex needs
    layer_growth: Annotated[Number, Field(gt=1, le=5)] = 1.5  # of the layers with the distance from the edge
    # growth with the distance of the water's cells that begin as large as those beside them at the wall; 0: they jump to wall_cell
    wall_grading: Annotated[float, Field(ge=0, le=1)] = 0.0
    planform: Literal["triangles", "quads"] = "triangles"  # cells beyond the layers at the wall
    max_non_orthogonality_deg: Annotated[Positive, Field(lt=90)] = 65.0
    # not exceeded for 95 % of the time
    usual_non_orthogonality_deg: Annotated[Positive, Field(lt=90)] = 70.0
    # pinch: along the plane from the contact, cells stay small
    jet_reach: NotNegative = 0.03


class Model(Section):
    """How much of the tank is computed: a plane, half of it (symmetry at the sheet), or all.

    A pinch has a second symmetry plane, x = 0 between its fingers: a `quarter` uses both, and `2d` uses that one too;
    `half` and `full` then hold both fingers.
    """

    kind: Literal["2d", "quarter", "half", "full"] = "half"


LONGEST_BALANCE = 2e-3  # s between two samples of power and energy: bursts of 8 ms have been seen


class Numerics(Section):
    """Time step (s) and what the solver does with it."""

    time_step: Positive
    write_interval: Positive = 0.02
    time_scheme: Literal["Euler", "backward"] = "backward"
    convection: Literal["LUST", "linearUpwind"] = "LUST"
    # values and gradients at faces; a scene that does not ask keeps the hash that it had before this could be asked
    interpolation: Literal["linear", "skewCorrected"] = Field(
        default="linear", exclude_if=lambda value: value == "linear"
    )
    outer_correctors: Annotated[Count, Field(le=50)] = 1
    pressure_correctors: Annotated[Count, Field(le=10)] = 2
    non_orthogonal_correctors: Annotated[Whole, Field(ge=0, le=10)] = 1
    max_courant: Annotated[Positive, Field(le=100)] = 20.0

    def sampling_steps(self, rate_hz: float) -> int:
        """Time steps between two pictures of the sheet; ValueError where that is no whole number."""
        steps = 1 / (rate_hz * self.time_step)
        if abs(steps - round(steps)) > 1e-6 * steps or round(steps) < 1:
            raise ValueError(
                f"numerics.time_step = {self.time_step:g} s does not divide the sheet's interval"
                f" {1 / rate_hz:g} s; give {1 / rate_hz / max(1, round(steps)):g}"
            )
        return round(steps)

    def balance_steps(self, rate_hz: float) -> int:
        """Time steps between two samples of power and energy: those of the sheet, or a part of them where they are rare.

        A burst of work between two samples would be missed, and the energy guard take it for energy from nothing.
        """
        sampling = self.sampling_steps(rate_hz)
        most = max(1, int(LONGEST_BALANCE / self.time_step * (1 + 1e-9)))
        return next(k for k in range(min(most, sampling), 0, -1) if sampling % k == 0)
