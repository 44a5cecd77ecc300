"""The sections of a scene.toml: tank, fluid, finger, motion, mesh, model and numerics."""

from itertools import pairwise
from typing import Annotated, Literal

from pydantic import Field, model_validator

from pipeline.scene.rigid_body import Law
from pipeline.scene.section import Count, NotNegative, Number, Pair, Positive, Section, Whole


class Tank(Section):
    """Inner size (x, y up, z) and water depth, m; origin at the centre of the bottom."""

    size: tuple[Positive, Positive, Positive] = (0.600, 0.330, 0.300)
    """Inner size: x, y up, z [m]"""
    water_depth: Positive = 0.300
    """From the bottom to the surface [m]"""


class Fluid(Section):
    """Water, and what is modelled of its turbulence."""

    density: Positive = 998.2
    """Of the water [kg/m³]"""
    kinematic_viscosity: Positive = 1.004e-6
    """Of the water [m²/s]"""
    turbulence: Literal["laminar", "WALE"] = "laminar"
    """None, or large-eddy simulation by WALE"""


class Tip(Section):
    """End of the finger: a straight, tapered extension and rounded corners, m."""

    length: NotNegative = 0.0
    """Of a straight extension of the finger [m]"""
    thickness: Positive | None = None
    """Of its end, to which it tapers; absent: the finger's [m]"""
    corner_radius: Positive = 0.002
    """Of the tip's rounded corners [m]"""

    @model_validator(mode="after")
    def _taper_has_length(self) -> "Tip":
        if self.thickness is not None and self.length == 0:
            raise ValueError(
                "a thickness is given but no length to taper over; give finger.tip.length"
            )
        return self


class Chambers(Section):
    """The gaps between the finger's chambers at rest, on its dorsal side; lengths in m."""

    count: Annotated[Whole, Field(ge=2, le=50)]
    """Of chambers, evenly along the finger [1]"""
    gap: Annotated[Positive, Field(ge=5e-4)]
    """Between two chambers [m]"""
    floor: Positive
    """Height of the gaps' bottom above the ventral side [m]"""
    wedge_from: Positive
    """Height from which on the chambers' walls lean away from each other [m]"""
    wedge_deg: Annotated[Number, Field(ge=0, le=45)] = 0.0
    """By how much each wall leans [deg]"""

    @model_validator(mode="after")
    def _wedge_above_floor(self) -> "Chambers":
        if self.wedge_from < self.floor:
            raise ValueError(
                f"finger.chambers.wedge_from = {self.wedge_from:g} m lies below floor ="
                f" {self.floor:g} m; raise it"
            )
        return self


class Mount(Section):
    """A round body at rest that carries the finger, whose root touches it; lengths in m."""

    diameter: Positive
    """Of the section, which is as wide along z as the finger [m]"""
    corner_radius: Positive = 0.002
    """Of the concave corners between it and the finger; layers at the wall fit into it [m]"""


class Finger(Section):
    """Pose and envelope, m; `root` is the middle of the root in the tank frame.

    Of a pinch it is the left one: `root` is at x = 0 in scene.toml, then at -pinch.half_distance.
    """

    root: Pair
    """Middle of the root, x and y in the tank frame; of a pinch x = 0 [m]"""
    length: Positive = 0.070
    """From root to tip, without finger.tip.length [m]"""
    thickness: Positive = 0.0145
    """Where the states of the bending analysis give none [m]"""
    width: Positive = 0.028
    """Extent along z [m]"""
    root_corner_radius: Positive = 0.002
    """Of the root's rounded corners [m]"""
    tilt_deg: Annotated[Number, Field(ge=-90, le=90)] = 0.0
    """About the root, counter-clockwise [deg]"""
    ventral: Literal["+x", "-x"] = "+x"
    """Side to which it bends under pressure"""
    tip: Tip = Tip()
    """End of the finger"""
    chambers: Chambers | None = None
    """Gaps between the chambers; absent: the dorsal side is smooth"""
    mount: Mount | None = None
    """Body that carries the finger; absent: none in the water"""


Pressure = Annotated[Number, Field(ge=-100, le=500)]  # kPa: no less than a vacuum


class _Segment(Section):
    """One stroke of a motion: a smooth change to a pressure."""

    pressure_kpa: Pressure
    """To go to [kPa]"""
    start: NotNegative
    """Of the stroke [s]"""
    duration: Positive
    """After which 2 % of the change are left [s]"""


SMOOTHING = 0.04  # s: a ramp of 0.5 s then starts as softly as a stroke of 0.4 s


class Motion(Section):
    """Where shapes and the pressure history come from."""

    source: Literal["fea", "paper_equations", "recording", "rigid", "structure"] = "paper_equations"
    """Of the shapes; "structure": pressure and water make the motion (COUPLED=1)"""
    states: str | None = None
    """Bending states (states.h5 or CSV), for "fea" and "structure"; own before a parent's"""
    recording: str | None = None
    """File of a motion as a camera saw it (motion.h5), for source = "recording" """
    recording_factor: Annotated[Positive, Field(le=10)] = 1.0
    """On the recording's bending, to measure what an error of it does [1]"""
    start_pressure_kpa: Pressure = 0.0
    """Before the first stroke [kPa]"""
    strokes: tuple[_Segment, ...] = ()
    """Changes of the pressure, one after the other"""
    pressure_csv: str | None = None
    """File of a measured pressure over time, a CSV with columns t,p (s, Pa), in place of strokes"""
    smoothing: Annotated[NotNegative, Field(le=10)] | None = None
    """Of pressure_csv: averaged over this time before each instant; absent: 0.04, 0: not [s]"""
    end_time: Positive
    """Of the run [s]"""
    max_bend_step_deg: Annotated[Positive, Field(ge=0.1, le=30)] = 5.0
    """Most bending between two shapes of the motion [deg]"""

    displacement: Law | None = None
    """Of a rigid body: law of its path [m]"""
    rotation: Law | None = None
    """Of a rigid body: law of its turn [deg]"""
    path_csv: str | None = None
    """Of a rigid body: file of its place along x, columns t, x [s, m], in place of a law"""
    path_step: Positive | None = None
    """Of a rigid body: distance between two shapes of the mesh [m or rad]"""

    @model_validator(mode="after")
    def _one_history(self) -> "Motion":
        laws = (self.displacement, self.rotation, self.path_csv)
        rigid = sum(law is not None for law in laws)
        if rigid != (self.source == "rigid") or (rigid and (self.strokes or self.pressure_csv)):
            raise ValueError(
                "motion.source = 'rigid' takes one of motion.displacement, rotation and path_csv,"
                " and no strokes"
            )
        if rigid:
            unused = {
                "states",
                "recording",
                "recording_factor",
                "start_pressure_kpa",
                "max_bend_step_deg",
            }
            for key in sorted(unused & self.model_fields_set):
                raise ValueError(
                    f"motion.{key} is a finger's; remove it beside motion.source = 'rigid'"
                )
            return self
        if self.path_step:
            raise ValueError(
                "motion.path_step is a rigid body's; give motion.max_bend_step_deg for a finger"
            )
        if self.source == "recording":
            if not self.recording or self.strokes or self.pressure_csv:
                raise ValueError(
                    "motion.source = 'recording' needs motion.recording, the path of a motion.h5,"
                    " and no strokes (strokes = []) and no pressure_csv beside it"
                )
            return self
        if self.recording or self.recording_factor != 1:
            raise ValueError(
                "motion.recording and recording_factor belong to motion.source = 'recording';"
                " remove them"
            )
        if self.strokes and self.pressure_csv:
            raise ValueError("give either motion.strokes or motion.pressure_csv, not both")
        if self.smoothing is not None and not self.pressure_csv:
            raise ValueError("motion.smoothing belongs to motion.pressure_csv; remove it")
        if self.pressure_csv and self.start_pressure_kpa != 0:
            raise ValueError(
                "motion.start_pressure_kpa belongs to motion.strokes; remove it beside"
                " motion.pressure_csv"
            )
        if any(b.start <= a.start for a, b in pairwise(self.strokes)):
            raise ValueError("motion.strokes must start one after the other; sort them by start")
        if self.source in ("fea", "structure") and not self.states:
            raise ValueError(
                f"motion.source = {self.source!r} needs motion.states, the path of a states.h5 or"
                " CSV"
            )
        return self


class Structure(Section):
    """The finger's answer to loads."""

    bending_stiffness: Positive | None = None
    """E I at all pressures, where the bending analysis does not say [N m²]"""
    loss_factor: Annotated[float, Field(ge=0, le=1)] = 0.12
    """Of the rubber: energy lost in a radian of vibration over the energy stored [1]"""
    density: Positive | None = None
    """Of a solid finger of bending_stiffness, whose neutral axis is half way up [kg/m³]"""
    gravity: NotNegative | None = None
    """Downwards; 0: the plane of the motion lies flat; absent: 9.81 [m/s²]"""

    @model_validator(mode="after")
    def _solid_is_stiff(self) -> "Structure":
        if self.density is not None and self.bending_stiffness is None:
            raise ValueError("density goes with bending_stiffness; give both or neither")
        return self


FINGER_LENGTH = 0.070  # m: that of a finger whose defaults are not scaled
# of [mesh]
SCALED = ("near_distance", "tip_distance", "tip_transition", "wall_distance", "jet_reach")


class Mesh(Section):
    """Planform and sweep: target cell sizes and layers, m.

    Defaults of `SCALED` are those of a finger of 70 mm; others scale them with their size.
    """

    wall_cell: Positive
    """Length of cells along the wall [m]"""
    wall_first_layer: Positive
    """Thickness of the first layer at the wall [m]"""
    wall_layers: Annotated[Count, Field(le=40)]
    """Number of layers at the wall"""
    wall_growth: Annotated[Number, Field(ge=1, le=2)] = 1.3
    """From layer to layer [1]"""
    wall_distance: Positive = 0.002
    """From the wall within which triangles are as small as at the wall [m]"""
    tip_cell: Positive
    """Length of cells along the wall near the tip [m]"""
    tip_distance: Positive = 0.012
    """From the tip along the wall over which cells are those of the tip [m]"""
    tip_transition: Positive = 0.02
    """Over which they grow from there to wall_cell [m]"""
    near_cell: Positive
    """Largest cell within near_distance [m]"""
    near_distance: Positive = 0.045
    """From where the tip is: see near [m]"""
    near: Literal["path", "tip"] = "path"
    """All the tip's places; or that of the shape which is meshed, whose cells move with the tip"""
    near_offset: tuple[Number, Number] = (0.0, 0.0)
    """With near = "tip", of the small cells' middle: beyond the tip, and behind its motion [m]"""
    far_cell: Positive
    """Largest cell of the tank [m]"""
    edge_layer: Positive = 1.0e-3
    """Thickness along z of the layers beside the finger's side edge [m]"""
    sheet_layer: Positive = 2.3e-3
    """Largest thickness along z between the side edges: what the sheet's vortex needs [m]"""
    layer_growth: Annotated[Number, Field(ge=1.02, le=5)] = 1.5
    """Of the layers along z with the distance from the edge [1]"""
    wall_grading: Annotated[float, Field(ge=0, le=1)] = 0.0
    """Growth of cells with the distance from the wall's, near = "tip": from all; 0: a jump [1]"""
    planform: Literal["triangles", "quads"] = "triangles"
    """Cells beyond the layers at the wall"""
    max_non_orthogonality_deg: Annotated[Positive, Field(lt=90)] = 65.0
    """Of any cell at any time; a coupled run, which finds its shapes, may exceed it by 8 [deg]"""
    usual_non_orthogonality_deg: Annotated[Positive, Field(lt=90)] = 70.0
    """Not exceeded for 95 % of the time [deg]"""
    jet_reach: NotNegative = 0.03
    """Of a pinch: along the plane from the contact, where cells stay small [m]"""


class Model(Section):
    """How much of the tank is computed: a plane, half of it (symmetry at the sheet), or all.

    A pinch has a second symmetry plane, x = 0: `quarter` and `2d` use it, `half` and `full` have
    both fingers.
    """

    kind: Literal["2d", "quarter", "half", "full"] = "half"
    """A plane, a quarter or half of the tank by its planes of symmetry, or all of it"""


_LONGEST_BALANCE = 2e-3  # s between two samples of power and energy: bursts of 8 ms have been seen


class Numerics(Section):
    """Time step (s) and what the solver does with it."""

    time_step: Positive
    """Of the solver [s]"""
    write_interval: Positive = 0.02
    """About the time between two checkpoints [s]"""
    time_scheme: Literal["Euler", "backward"] = "backward"
    """OpenFOAM's scheme in time"""
    convection: Literal["LUST", "linearUpwind"] = "LUST"
    """OpenFOAM's scheme of convection"""
    interpolation: Literal["linear", "skewCorrected"] = "linear"
    """Values and gradients at faces"""
    outer_correctors: Annotated[Count, Field(le=50)] = 1
    """Iterations over momentum and pressure in a step"""
    pressure_correctors: Annotated[Count, Field(le=10)] = 2
    """Of a step"""
    non_orthogonal_correctors: Annotated[Whole, Field(ge=0, le=10)] = 1
    """Of each pressure correction"""
    max_courant: Annotated[Positive, Field(ge=0.01, le=100)] = 20.0
    """Courant number at which the run is stopped [1]"""

    def sampling_steps(self, rate_hz: float) -> int:
        """Time steps between two pictures of the sheet; ValueError unless a whole number."""
        steps = 1 / (rate_hz * self.time_step)
        if abs(steps - round(steps)) > 1e-6 * steps or round(steps) < 1:
            raise ValueError(
                f"numerics.time_step = {self.time_step:g} s does not divide the sheet's interval"
                f" {1 / rate_hz:g} s; give {1 / rate_hz / max(1, round(steps)):g}"
            )
        return round(steps)

    def balance_steps(self, rate_hz: float) -> int:
        """Time steps between two samples of power and energy: a part of the sheet's, where rare.

        The energy guard would take a burst of work between two samples for energy from nothing.
        """
        sampling = self.sampling_steps(rate_hz)
        most = max(1, int(_LONGEST_BALANCE / self.time_step * (1 + 1e-9)))
        return next(k for k in range(min(most, sampling), 0, -1) if sampling % k == 0)
