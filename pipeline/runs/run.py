"""A run: a scene at a level with overrides, resolved once, and the state of its stages."""

import hashlib
import math
import os
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

from pipeline.fea.sections import check_length, sections
from pipeline.fea.up_to_date import check_states
from pipeline.formats.kinematics import read_kinematics
from pipeline.kinematics.camera_window import following, tip_path, unseen_tip
from pipeline.kinematics.values import kinematics_values
from pipeline.openfoam.base_case import BASE, template_files
from pipeline.runs.seal import is_sealed
from pipeline.runs.sources import sources_digest
from pipeline.runs.stages import BY_NAME, COUPLED, FEA, FILMED, TARGETS, Stage, until
from pipeline.scene.measurement import frames_apart
from pipeline.scene.read_toml import FILE_KEYS
from pipeline.scene.scene import Scene, load_scene
from pipeline.structure.finger import ElasticFinger, modelled_speed, path_in_water
from piv.files.atomic import sha256
from piv.files.errors import StageError
from piv.files.json_text import flat
from piv.files.provenance import digest
from piv.files.record import changed_outputs, check_own, read_record, record_path

FILES = {f"motion.{key}" for key in FILE_KEYS} | {"current.table"}
_ANALYSED = ("actuator", "fea")  # sections of the bending analysis
NOT_FASTER = 1.25  # of the speed of a tip for which steps were chosen
_DEPTHS = ("*", "*/*", "*/*/*")  # of runs below a scene's folder out/


@dataclass(frozen=True)
class Run:
    """The stages of one scene at one level, and their files in `scene.out`.

    `analysed`: the run computes the bending states of its own actuator first. `ranks`: MPI ranks
    where a study compares them; they are then among the numbers of the solver's stage.
    """

    scene: Scene
    overrides: Mapping[str, Any] = field(default_factory=dict)
    analysed: bool = False
    ranks: int | None = None

    @property
    def out(self) -> Path:
        """Folder of the results."""
        return self.scene.out

    def stage(self, name: str) -> Stage:
        """The row of a stage: of a coupled run, and without camera and PIV, where it is one."""
        row = (COUPLED if self.scene.coupled else {}).get(name, BY_NAME[name])
        if self.scene.filmed or name in FILMED:
            return row
        return replace(row, inputs=tuple(each for each in row.inputs if each not in FILMED))

    @property
    def motion(self) -> str:
        """Name of the stage that gives the motion and the meshes of the flow."""
        return "solve" if self.scene.coupled else "kinematics"

    def path(self, stage: str) -> Path:
        """The first file of a stage."""
        return self.out / self.stage(stage).done

    def inputs(self, stage: str) -> tuple[str, ...]:
        """Names of the stages that a stage reads."""
        return ("fea",) if self.analysed and stage == "kinematics" else self.stage(stage).inputs

    @cached_property
    def _numbers(self) -> dict[str, Any]:
        return self.scene.model_dump(mode="json")

    def made_from(self, stage: str) -> dict[str, Any]:
        """Inputs of a stage: version, numbers, digests of files, of results that it reads, of code.

        Keys without a value are omitted, so that a new optional key makes no result stale.
        """
        step = self.stage(stage)
        numbers: dict[str, Any] = {}
        for section, keys in step.sections.items():
            part = self._numbers[section]
            chosen = part if keys is True else {k: v for k, v in part.items() if k in keys}
            numbers |= flat({section: chosen})
        numbers = {k: v for k, v in numbers.items() if v is not None and k not in FILES}
        if step.ranks and self.ranks is not None:
            numbers["ranks"] = self.ranks
        files = {name: _sum(path) for name, path in sorted(_files(step, self.scene).items())}
        if self.analysed:
            files.pop("motion.states", None)  # the result of the stage fea, an input
        inputs = {name: self.digest(name) for name in self.inputs(stage)}
        made = {"version": step.version, "numbers": numbers, "files": files, "inputs": inputs}
        return made | ({"sources": sources_digest(step.module)} if step.by_sources else {})

    def digest(self, stage: str) -> str:
        """Digest of `made_from`: two results with the same digest are equal."""
        if stage not in self._digests:
            self._digests[stage] = digest([stage, self.made_from(stage)])
        return self._digests[stage]

    @cached_property
    def _digests(self) -> dict[str, str]:
        return {}

    def why_stale(self, stage: str) -> str | None:
        """Why a stage is stale; None where its result exists and has these inputs."""
        record = read_record(self.out, stage)
        if record is None:
            return "not made yet"
        if record["digest"] != self.digest(stage):
            return _difference(record["made_from"], self.made_from(stage))
        if self.stage(stage).sealed and not is_sealed(record):
            return "it was not made by this clone"
        return next(iter(changed_outputs(self.out, record).values()), None)

    def stale(self, target: str) -> dict[str, str]:
        """The stages to be made for a target, in order, and why each.

        Of a temporary stage a file may be missing, where no stale stage needs it.
        """
        reasons: dict[str, str] = {}

        def visit(stage: str) -> None:
            if stage in reasons:
                return
            why = self.why_stale(stage)
            for name in self.inputs(stage):
                if why or not self.stage(name).temporary:
                    visit(name)
            if why:
                reasons[stage] = why

        for stage in targets(target):
            visit(stage)
        return reasons

    def twin(self, stage: str) -> Path | None:
        """Folder of another run of this scene with the same result of a stage; None without one."""
        for out in _other_runs(self.scene, stage):
            record = read_record(out, stage)
            same = record and record["digest"] == self.digest(stage) and out != self.out
            trusted = not self.stage(stage).sealed or (record and is_sealed(record))
            if record and same and trusted and not changed_outputs(out, record):
                with suppress(StageError):  # links that lead elsewhere are not taken over
                    check_own(out)
                    return out
        return None

    def check(self, target: str) -> None:
        """StageError where the states are of another actuator, or the tip leaves the picture."""
        if target == FEA.name and not self.analysed:
            raise StageError(
                "fea: this run has the actuator of its scene; use softfinger fea, or --set a key"
                " of actuator or fea"
            )
        if self.analysed:
            check_length(self.scene, sections(self.scene)[0])
        else:
            check_states(self.scene)
        if self.scene.body is None and BY_NAME["sheet"] in until(target):
            self._check_view()

    def _check_view(self) -> None:
        """StageError where the tip leaves the camera's picture, or its path is not known."""
        known = self.why_stale(self.motion) is None
        if known or self.why_stale("kinematics") is None:  # nearer to the motion of the run
            folder = self.scene.motion_folder if known else self.out
            tip = read_kinematics(folder / "kinematics.h5").data["shape_tip"].values
        elif self.analysed and self.scene.camera.centre is not None:
            return  # the states are not there yet
        else:
            tip = tip_path(self.scene).places
        if why := unseen_tip(self.scene.camera, tip):
            # a finger that leaves the water leaves the picture, too: no other camera would help
            try:
                kinematics_values(self.scene)
            except StageError as error:
                raise StageError(f"kinematics: {error}") from None
            raise StageError(f"{self.scene.folder / 'scene.toml'}: {why}")


def open_run(
    folder: str | Path,
    level: str = "coarse",
    overrides: Mapping[str, Any] | None = None,
    out: Path | None = None,
    ranks: int | None = None,
) -> Run:
    """The run of a scene's folder at a level, with `overrides` by dotted keys. StageError.

    Overrides need a folder `out` of their own. Where they change the actuator or its analysis,
    the bending states are computed in that folder.
    """
    overrides = dict(overrides or {})
    analysed = any(key.split(".")[0] in _ANALYSED for key in overrides)
    if analysed:
        states = os.path.relpath((out or Path()) / FEA.done, folder)
        overrides = {"motion.source": "fea"} | overrides | {"motion.states": states}
    scene = load_scene(folder, level, overrides, out)
    if scene.camera.centre is None:
        view = _view(load_scene(folder, level) if analysed else scene)
        scene = load_scene(folder, level, overrides | view, out) if view else scene
    return Run(scene, overrides, analysed, ranks)


def _view(scene: Scene) -> dict[str, Any]:
    """Values of the measurement that follow from the motion; none before its files are there."""
    try:
        return following(scene, path_in_water(scene))
    except StageError:
        return {}  # `Run.check` says why


def coupled_out(out: Path) -> Path:
    """Folder of the coupled run beside the results `out` of a prescribed one."""
    return out / "coupled"


def other_motion(scene: Scene) -> tuple[dict[str, Any], Path]:
    """Overrides and folder of a scene's coupled run, or of the prescribed one of a coupled scene.

    A finger that water does not slow may be faster, and then takes shorter steps. StageError.
    """
    if not scene.coupled:
        overrides = {"motion.source": "structure", "title": f"{scene.title}, coupled"}
        return overrides, coupled_out(scene.out)
    check_states(scene)
    wet = modelled_speed(ElasticFinger.of(scene), scene.motion.end_time)
    faster = tip_path(scene).speed / wet / NOT_FASTER
    parts = 2 ** max(0, math.ceil(math.log2(faster)))
    return {
        "motion.source": "fea",
        "title": f"{scene.title}, prescribed",
        "numerics.time_step": scene.numerics.time_step / parts,
    }, scene.out / "prescribed"


def other_films(scene: Scene) -> tuple[dict[str, Any], Path]:
    """Overrides and folder of a scene's run without camera and PIV, or with them if it has none."""
    # vortices at the instants of vector fields are plenty, and pictures cost more than the solver
    every = frames_apart(scene.camera, scene.piv) if scene.filmed else 1
    overrides = {"filmed": not scene.filmed, "sheet.every": every if every > 1 else None}
    return overrides, scene.out / ("flow" if scene.filmed else "filmed")


def single_finger_out(pinch: Scene) -> Path:
    """Folder of the results of the single finger that a pinch extends, moved as the pinch is."""
    out = pinch.parents[-1] / "out" / pinch.level
    return coupled_out(out) if pinch.coupled else out


def run_of(row: Mapping[str, Any]) -> Run:
    """The run that a row of a study's plan describes."""
    out, ranks = Path(row["out"]), row["compared_ranks"]
    return open_run(row["folder"], row["level"], row["overrides"], out, ranks)


def targets(target: str) -> list[str]:
    """The stages that a target names: a stage, or a group of them. StageError for another name."""
    if target == FEA.name:
        return [FEA.name]
    if target not in TARGETS:
        raise StageError(f"{target}: no such stage; the stages are {', '.join(TARGETS)}")
    return [stage.name for stage in until(target) if target in (stage.name, stage.group)]


def _other_runs(scene: Scene, stage: str) -> Iterator[Path]:
    roots = dict.fromkeys([scene.folder / "out", scene.out.parent])
    for root in roots:
        for depth in _DEPTHS:
            for path in sorted(root.glob(f"{depth}/{record_path(Path(), stage)}")):
                yield path.parents[1]


def _files(stage: Stage, scene: Scene) -> dict[str, Path]:
    """Files that a stage reads besides the results of others, by a name without folder."""
    files: dict[str, Path] = {}
    table = getattr(scene.current, "table", None)
    if table and "current" in stage.sections:
        files["current.table"] = scene.folder / table
    if stage.name == "kinematics":
        named = {key: getattr(scene.motion, key) for key in FILE_KEYS}
        return files | {f"motion.{key}": scene.folder / name for key, name in named.items() if name}
    if stage.name == "case":
        return files | {path.relative_to(BASE).as_posix(): path for path in template_files()}
    if stage.name == "fea":
        results = scene.fea.get("results", {})
        names = {key: results[key] for key in ("file", "displacements") if results.get(key)}
        return {f"fea.results.{key}": scene.folder / name for key, name in names.items()}
    if stage.name == "compare":
        files = {path.name: path for path in (scene.folder / "reference").glob("*.toml")}
        if scene.pinch is not None and scene.parents:  # compared with the single finger
            beside = single_finger_out(scene)
            files |= {path.name: path for path in beside.glob("vortices_*.csv")}
            files["sheet"] = record_path(beside, "sheet")
        return files
    if stage.name == "report":
        return {
            f"errors of {folder.name}": folder / "studies" / "results" / "errors.csv"
            for folder in (scene.folder, *scene.parents)
        }
    return {}


def _sum(path: Path) -> str:
    if path.is_file():
        return sha256(path)[:16]
    total = hashlib.sha256()  # a pattern of files, as fea.results.file may be
    for found in sorted(path.parent.glob(path.name)) if "*" in path.name else ():
        total.update(f"{found.name} {sha256(found)}\n".encode())
    return total.hexdigest()[:16]


def _difference(was: dict[str, Any], now: dict[str, Any]) -> str:
    """The first difference between the recorded inputs of a result and the present ones."""
    old, new = was.get("numbers", {}), now["numbers"]
    for key in sorted(old.keys() | new.keys()):
        if old.get(key) != new.get(key):
            return f"{key} changed from {old.get(key)} to {new.get(key)}"
    for kind, text in (("files", "the file of {} changed"), ("inputs", "{} is made again")):
        for key in sorted(was.get(kind, {}).keys() | now[kind].keys()):
            if was.get(kind, {}).get(key) != now[kind].get(key):
                return text.format(key)
    return "its code changed"
