"""The scene: every number of a case, read from scene.toml, resolved for one level and checked."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, ValidationError, model_validator

from pipeline.errors import StageError
from pipeline.limits import check_numbers
from pipeline.rigid_scene import Body, Law
from pipeline.scene_file import level_tables, merge, read_tables
from pipeline.scene_picture import Camera, Piv, Sheet, Vortices, piv_settings, render_settings
from pipeline.scene_pinch import Pinch, Support, check_pinch, check_support
from pipeline.scene_section import Pair, Positive, Section, validation_sentence
from pipeline.templates import templates_digest


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

    length: Annotated[float, Field(ge=0)] = 0.0
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
    tilt_deg: float = 0.0  # about the root, counter-clockwise
    ventral: Literal["+x", "-x"] = "+x"
    tip: Tip = Tip()


class Segment(Section):
    """One stroke of a motion: go to `pressure_kpa` from `start` on, 2 % settled after `duration`, s."""

    pressure_kpa: float
    start: Annotated[float, Field(ge=0)]
    duration: Positive


class Motion(Section):
    """Where shapes and the pressure history come from."""

    source: Literal["fea", "paper_equations", "recording", "rigid"] = "paper_equations"
    states: str | None = None
    recording: str | None = None  # of source "recording": motion as a camera saw it (docs/formats.md)
    recording_factor: Positive = 1.0  # on its bending, to measure what an error of it does
    start_pressure_kpa: float = 0.0
    strokes: tuple[Segment, ...] = ()
    pressure_csv: str | None = None
    end_time: Positive
    max_bend_step_deg: Positive = 5.0

    displacement: Law | None = None  # of a rigid body, m
    rotation: Law | None = None  # of a rigid body, deg
    path_step: Positive | None = None  # way of a rigid body between two shapes of the mesh

    @model_validator(mode="after")
    def _one_history(self) -> Motion:
        rigid = (self.displacement is not None) + (self.rotation is not None)
        if rigid != (self.source == "rigid") or (rigid and (self.strokes or self.pressure_csv)):
            raise ValueError(
                "motion.source = 'rigid' takes either motion.displacement or motion.rotation and nothing else"
            )
        if rigid:
            return self
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


class Mesh(Section):
    """Planform and sweep: target cell sizes and layers, m."""

    wall_cell: Positive
    wall_first_layer: Positive
    wall_layers: Annotated[int, Field(ge=1, le=40)]
    wall_growth: Annotated[float, Field(ge=1, le=2)] = 1.3
    tip_cell: Positive
    near_cell: Positive
    near_distance: Positive = 0.045
    far_cell: Positive
    layers_on_finger: Annotated[int, Field(ge=1)] = 6
    layers_beyond: Annotated[int, Field(ge=1)] = 7
    max_non_orthogonality_deg: Annotated[float, Field(gt=0, lt=90)] = 65.0
    usual_non_orthogonality_deg: Annotated[float, Field(gt=0, lt=90)] = (
        70.0  # not exceeded for 95 % of the time
    )
    jet_reach: Annotated[float, Field(ge=0)] = (
        0.03  # pinch: along the plane from the contact, cells stay small
    )


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
    outer_correctors: Annotated[int, Field(ge=1)] = 1
    pressure_correctors: Annotated[int, Field(ge=1)] = 2
    non_orthogonal_correctors: Annotated[int, Field(ge=0)] = 1
    max_courant: Positive = 20.0

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


class Scene(Section):
    """One scene at one level."""

    name: str
    title: str
    level: str
    folder: Path
    tank: Tank = Tank()
    fluid: Fluid = Fluid()
    finger: Finger
    body: Body | None = None  # in the finger's place: validation against what is known of it
    pinch: Pinch | None = None
    support: Support | None = None
    motion: Motion
    model: Model = Model()
    mesh: Mesh
    numerics: Numerics
    sheet: Sheet = Sheet()
    camera: Camera
    piv: Piv = Piv()
    vortices: Vortices = Vortices()
    actuator: dict[str, Any] = Field(default_factory=dict)
    fea: dict[str, Any] = Field(default_factory=dict)

    @model_validator(mode="before")
    @classmethod
    def _quarter_of_a_pinch(cls, table: Any) -> Any:
        if isinstance(table, dict) and table.get("pinch") is not None and "model" not in table:
            return table | {"model": {"kind": "quarter"}}
        return table

    @model_validator(mode="before")
    @classmethod
    def _body_for_finger(cls, table: Any) -> Any:
        """A rigid body takes the finger's place: its centre is the root, its depth the width."""
        body = table.get("body") if isinstance(table, dict) else None
        if isinstance(body, dict) and "centre" in body:
            if "finger" in table:
                raise ValueError("give either finger or body")
            table = {**table, "finger": {"root": body["centre"], "width": body.get("depth", 1.0)}}
        return table

    @model_validator(mode="after")
    def _one_body(self) -> Scene:
        if (self.body is None) == (self.motion.source == "rigid"):
            raise ValueError("body and motion.source = 'rigid' belong together; give both or neither")
        return self

    @model_validator(mode="after")
    def _physical(self) -> Scene:
        tank, finger = self.tank, self.finger
        if tank.water_depth > tank.size[1]:
            raise ValueError(
                f"tank.water_depth = {tank.water_depth} m exceeds the tank's height {tank.size[1]} m"
            )
        if self.body is None and (finger.length > 1 or max(tank.size) > 20):
            raise ValueError("finger.length or tank.size looks like millimetres; give metres")
        if not abs(finger.root[0]) < tank.size[0] / 2 or not 0 < finger.root[1] < tank.water_depth:
            raise ValueError(
                f"finger.root = {list(finger.root)} is not in the water; move it inside the tank"
            )
        reach = finger.length + finger.tip.length
        if finger.root[1] - reach < 0.1:
            raise ValueError(
                f"finger.root leaves the tip {finger.root[1] - reach:.3f} m above the bottom,"
                " less than the experiment's 0.1 m; raise finger.root"
            )
        if finger.width >= tank.size[2]:
            raise ValueError(f"finger.width = {finger.width} m does not fit between the tank's walls")
        if self.pinch is not None:
            check_pinch(self.pinch, finger, tank, self.motion.start_pressure_kpa)
        elif self.model.kind == "quarter":
            raise ValueError(
                "model.kind = 'quarter' needs the second symmetry plane of [pinch]; give 'half' for a single finger"
            )
        if self.support is not None:
            check_support(self.support, finger, tank)
        check_numbers(self)
        self.numerics.sampling_steps(self.sheet.rate_hz)
        steps = self.motion.end_time / self.numerics.time_step
        if abs(steps - round(steps)) > 1e-6 * steps or round(steps) < 1:
            raise ValueError(
                f"motion.end_time = {self.motion.end_time:g} s is no whole number of numerics.time_step ="
                f" {self.numerics.time_step:g} s; give {max(1, round(steps)) * self.numerics.time_step:g}"
            )
        if self.camera.pairs_every > 1 and self.piv.frames > 2:
            raise ValueError(
                f"piv.frames = {self.piv.frames} needs every frame; give camera.pairs_every = 1, or piv.frames = 2"
            )
        if abs(self.sheet.z) >= tank.size[2] / 2:
            raise ValueError(f"sheet.z = {self.sheet.z} m lies outside the tank")
        if self.model.kind != "full" and self.sheet.z != 0:
            raise ValueError("sheet.z must be 0 unless model.kind = 'full': the sheet is the symmetry plane")
        return self

    def placed(self) -> Scene:
        """The scene with the fingers of a pinch where it hangs them; itself without a pinch."""
        if self.pinch is None:
            return self
        finger = self.finger.model_copy(update={"root": (-self.pinch.half_distance, self.finger.root[1])})
        return self.model_copy(update={"finger": finger})

    @property
    def out(self) -> Path:
        """Folder of everything generated at this level."""
        return self.folder / "out" / self.level

    def digest(self) -> str:
        """Hash of every number of the scene at this level."""
        return digest(self.model_dump(mode="json", exclude={"folder"}))

    def settings(self, stage: str) -> dict[str, Any]:
        """The part of the scene that a stage's results depend on, with the digests of the files it names or is written from."""
        if stage in FLAT_SETTINGS:
            return FLAT_SETTINGS[stage](self)
        settings = self.model_dump(mode="json", include=STAGE_SECTIONS[stage])
        if stage == "kinematics":
            named = [self.motion.states, self.motion.pressure_csv, self.motion.recording]
            settings["files"] = {name: _file_digest(self.folder / name) for name in named if name}
        if stage == "case":
            settings["templates"] = templates_digest()
        return settings


# What each stage's results depend on, so that touching a key redoes only what follows from it.
STAGE_SECTIONS: dict[str, Any] = {
    "kinematics": {"tank", "finger", "body", "pinch", "support", "motion"},
    # a leg begins with a picture of the sheet, and its planform's shapes cover a run-in of so many time steps
    "mesh": {"mesh": True, "model": True, "support": True, "numerics": {"time_step"}, "sheet": {"rate_hz"}},
    # the solver needs no more of the sheet than this: a finer grid does not solve again
    "case": {"fluid": True, "numerics": True, "sheet": {"rate_hz", "z"}},
    "run": set(),
    "sheet": {"sheet": {"spacing"}, "camera": {"columns", "rows", "scale_mm_per_px", "centre"}},
    "images": {"camera", "sheet"},
    "piv": {"piv"},
    "vortices": {"vortices"},
    "report": {"title"},
}


# The stages of piv/ know nothing of scenes: they get their own flags, by name, as a settings file.
FLAT_SETTINGS: dict[str, Callable[[Scene], dict[str, Any]]] = {
    "images": lambda scene: render_settings(scene.camera, scene.sheet),
    "piv": lambda scene: piv_settings(scene.piv, scene.camera),
    "vortices": lambda scene: scene.vortices.model_dump(mode="json"),
}


def _file_digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()[:16] if path.exists() else "missing"


def digest(value: Any) -> str:
    """Short SHA-256 of a JSON-able value."""
    return hashlib.sha256(json.dumps(value, sort_keys=True, default=str).encode()).hexdigest()[:16]


def load_scene(folder: str | Path, level: str = "coarse") -> Scene:
    """Read `<folder>/scene.toml`, apply `[levels.<level>]`, and check it.

    A scene may say `extends = "../other"`: it then holds only what differs. Raises StageError in one sentence.
    """
    folder = Path(folder)
    path = folder / "scene.toml"
    table = read_tables(path)
    levels = table.pop("levels", {})
    table = merge(table, level_tables(levels, level, path))
    for key in ("name", "level", "folder"):
        if key in table:
            raise StageError(f"{path}: {key}: this key is not known; check its spelling or remove it")
    try:
        return Scene(**table, name=folder.name, level=level, folder=folder).placed()
    except ValidationError as error:
        raise StageError(f"{path}: {validation_sentence(error)}") from None
    except ArithmeticError as error:
        raise StageError(
            f"{path}: a number is too large or too small to reckon with ({error}); lengths are in m, times in s"
        ) from None
