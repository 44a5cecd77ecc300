"""The scene: every number of a case, read from scene.toml, resolved for one level and checked."""

import math
import os
import shutil
from collections.abc import Mapping
from functools import reduce
from pathlib import Path
from typing import Any

from pydantic import Field, ValidationError, model_validator

from pipeline.scene.current import Current, current_remarks
from pipeline.scene.limits import check_scene
from pipeline.scene.measurement import Camera, Piv, Sheet, Vortices
from pipeline.scene.obstacle import Obstacle, merge_short_sides
from pipeline.scene.pinch import Pinch, Support
from pipeline.scene.predicted import predicted
from pipeline.scene.read_toml import merge, read_layers, resolve
from pipeline.scene.rigid_body import RigidBody
from pipeline.scene.section import Section, validation_sentence
from pipeline.scene.sections import (
    FINGER_LENGTH,
    SCALED,
    Finger,
    Fluid,
    Mesh,
    Model,
    Motion,
    Numerics,
    Structure,
    Tank,
)
from piv.files.errors import StageError

_PAPER_CLEARANCE = 0.1  # m of water, or more, below the tip in the experiment


class Scene(Section):
    """One scene at one level."""

    name: str
    title: str
    filmed: bool = True
    """By a virtual camera, for PIV; false: a page of the flow alone (PIV=0)"""
    level: str
    folder: Path
    parents: tuple[Path, ...] = ()  # folders of the scenes that it extends, nearest first
    out: Path  # folder of everything that is generated
    notes: tuple[str, ...] = ()  # on how the scene was read
    tank: Tank = Tank()
    fluid: Fluid = Fluid()
    current: Current | None = None
    finger: Finger
    body: RigidBody | None = None  # in the finger's place
    pinch: Pinch | None = None
    support: Support | None = None
    obstacle: tuple[Obstacle, ...] | None = None
    motion: Motion
    structure: Structure = Structure()
    model: Model = Model()
    mesh: Mesh
    numerics: Numerics
    sheet: Sheet = Sheet()
    camera: Camera = Camera()
    piv: Piv = Piv()
    vortices: Vortices = Vortices()
    actuator: dict[str, Any] = Field(default_factory=dict)
    fea: dict[str, Any] = Field(default_factory=dict)

    @model_validator(mode="before")
    @classmethod
    def _follow_from_other_sections(cls, table: dict[str, Any]) -> dict[str, Any]:
        """Defaults from other sections: a pinch is a quarter; a rigid body replaces the finger.

        Lengths are those of a finger of 70 mm, scaled with the finger or body.
        """
        table = dict(table)
        if table.get("pinch") is not None:
            table.setdefault("model", {"kind": "quarter"})
        body = table.get("body")
        if isinstance(body, dict) and "centre" in body:
            if "finger" in table:
                raise ValueError("give either finger or body")
            table["finger"] = {"root": body["centre"], "width": body.get("depth", 1.0)}
        thing = body or table.get("finger")
        thing = thing if isinstance(thing, dict) else {}
        size = thing.get("diameter", thing.get("chord", thing.get("length", FINGER_LENGTH)))
        for name, section, keys in (("mesh", Mesh, SCALED), ("sheet", Sheet, ("margin",))):
            own = table.get(name, {})
            # otherwise the section's own check complains
            if isinstance(own, dict) and isinstance(size, int | float):
                scale = size / FINGER_LENGTH
                table[name] = {key: section.model_fields[key].default * scale for key in keys} | own
        return table

    @model_validator(mode="after")
    def _checked(self) -> "Scene":
        if (self.body is None) == (self.motion.source == "rigid"):
            raise ValueError(
                "body and motion.source = 'rigid' belong together; give both or neither"
            )
        if self.body is not None and self.camera.centre is None:
            raise ValueError("camera.centre: this key is missing; a rigid body's scene needs it")
        if self.body is not None and self.pinch is not None:
            raise ValueError("pinch: a rigid body has no second finger; remove it")
        check_scene(self)
        return self

    @property
    def coupled(self) -> bool:
        """Whether pressure and water make the motion together."""
        return self.motion.source == "structure"

    @property
    def motion_folder(self) -> Path:
        """Folder of the flow's motion and meshes: kinematics.h5, planform.h5, mesh_quality.csv.

        A coupled solver writes its own; those in `out` are a first guess then.
        """
        return self.out / "run" if self.coupled else self.out

    @property
    def both_fingers(self) -> bool:
        """Whether the mesh holds both fingers of a pinch, not one beside its plane of symmetry."""
        return self.pinch is not None and self.model.kind in ("half", "full")

    def placed(self) -> "Scene":
        """The scene with the fingers of a pinch where it hangs them; itself without a pinch."""
        if self.pinch is None:
            return self
        finger = self.finger.model_copy(
            update={"root": (-self.pinch.half_distance, self.finger.root[1])}
        )
        return self.model_copy(update={"finger": finger})

    @property
    def load_share(self) -> float:
        """The share of a plane flow's loads that moves a coupled finger; 1 in space.

        A plane flow goes around the tip alone, and water that goes around the width is lighter. By
        slender-body theory a finger of length L and width W that turns about its root moves water
        with π ρ W² L³ / 24 (energy over its rate squared), and a plate of chord L in a plane with
        9 π ρ W L⁴ / 256. The share is their ratio, 32 W / 27 L, or 1 where the finger is wide.
        """
        if self.model.kind != "2d" or self.body is not None:
            return 1.0
        return min(1.0, 32 / 27 * self.finger.width / (self.finger.length + self.finger.tip.length))

    def pressure_settings(self) -> dict[str, Any]:
        """The settings of `piv pressure`: moments about finger 0's root, or the body's centre."""
        return {
            "density": self.fluid.density,
            "viscosity": self.fluid.kinematic_viscosity,
            "about": self.body.centre if self.body else self.finger.root,
        }

    def remarks(self) -> list[str]:
        """Warnings about a scene that is valid but may not be as its author thinks."""
        remarks, motion = list(self.notes), self.motion
        hangs = math.cos(math.radians(self.finger.tilt_deg))
        length = self.finger.length + self.finger.tip.length
        above = self.finger.root[1] - hangs * length
        if self.body is None and above < _PAPER_CLEARANCE - 1e-6:
            remarks.append(
                f"warning: finger.root = {list(self.finger.root)} leaves the straight finger"
                f" {above:.3g} m above the bottom, less than the experiment's {_PAPER_CLEARANCE:g}"
                " m: the bottom may be felt"
            )
        width, analysed = self.finger.width, self.actuator.get("width")
        if motion.states and motion.source not in ("fea", "structure"):
            remarks.append(f"motion.states is not used: motion.source = {motion.source!r}")
        elif (motion.states or "").endswith(".h5") and analysed not in (None, width):
            remarks.append(
                f"warning: finger.width = {width:g} m, but the bending states are of"
                f" actuator.width = {analysed:g} m; make them equal for an own finger"
            )
        remarks += [
            f"warning: motion.strokes[{k}] starts at {stroke.start:g} s, not before motion.end_time"
            f" = {motion.end_time:g} s: it does nothing"
            for k, stroke in enumerate(motion.strokes)
            if stroke.start >= motion.end_time
        ]
        remarks += current_remarks(self)
        size = predicted(self)
        folder = next(p for p in (self.out, *self.out.absolute().parents) if p.exists())
        memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
        for kind, wanted, there in (
            ("memory", size.memory, memory),
            ("disk", size.disk, shutil.disk_usage(folder).free),
        ):
            if wanted > there:
                remarks.append(
                    f"warning: this takes {size}, but there are {there / 1e9:.3g} GB of {kind} here"
                )
        return remarks


def load_scene(
    folder: str | Path,
    level: str = "coarse",
    overrides: Mapping[str, Any] | None = None,
    out: Path | None = None,
) -> Scene:
    """Read `<folder>/scene.toml` at a level, with values in place of others by dotted keys.

    A scene may say `extends = "../other"`: it then holds only what differs. `out`: folder of the
    results, `<folder>/out/<level>` where none is named. Raises StageError in one sentence.
    """
    folder = Path(folder)
    path = folder / "scene.toml"
    layers = read_layers(path)
    table, replaced = resolve(layers, level)
    values = ", ".join(f"{key} of {where}" for key, where in sorted(replaced.items()))
    notes = (f"{values}: used in place of the parent's [levels.{level}]",) if values else ()
    for key, value in (overrides or {}).items():
        names = key.split(".")
        table = merge(table, reduce(lambda inner, name: {name: inner}, reversed(names), value))
    for key in ("name", "level", "folder", "parents", "out", "notes"):
        if key in table:
            raise StageError(
                f"{path}: {key}: this key is not known; check its spelling or remove it"
            )
    parents = tuple(layer.path.parent for layer in layers[-2::-1])
    place: dict[str, Any] = {
        "parents": parents,
        "out": out or folder / "out" / level,
        "notes": notes,
    }
    try:
        scene = Scene(**table, name=folder.name, level=level, folder=folder, **place).placed()
        obstacles, remarks = merge_short_sides(scene.obstacle or (), scene.mesh.wall_cell)
        more = {"obstacle": obstacles or None, "notes": (*notes, *remarks)}
        return scene.model_copy(update=more) if remarks else scene
    except ValidationError as error:
        raise StageError(f"{path}: {validation_sentence(error, Scene)}") from None
    except ValueError as error:
        raise StageError(f"{path}: {error}") from None
    except ArithmeticError as error:
        raise StageError(
            f"{path}: a number is too large or too small ({error}); lengths are in m, times in s"
        ) from None
