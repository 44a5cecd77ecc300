"""Stage settings: the scene resolved for one level, one small file per stage that changes only if its content does."""

from __future__ import annotations

import argparse
import contextlib
import hashlib
import json
import os
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

from fileio.atomic import checksums_of, write_text
from fileio.command import add_scene as add_arguments  # noqa: F401 (of the command)
from fileio.errors import StageError
from fileio.formats import vortex_table
from fileio.formats.__main__ import SCHEMAS
from fileio.formats.records import RECORDS
from fileio.json_text import given, parse_json
from fileio.lock import exclusive, held
from fileio.stages import BY_NAME, STAGES
from pipeline.fea.up_to_date import check_states
from pipeline.openfoam.base_case import templates_digest
from pipeline.scene.measurement import piv_settings, render_settings
from pipeline.scene.read_toml import FILE_KEYS, read_layers, resolve
from pipeline.scene.scene import Scene, load_scene

# What each stage's results depend on, so that touching a key redoes only what follows from it.
STAGE_SECTIONS = {stage.target: stage.sections for stage in STAGES if stage.sections}
# A new version of what a stage writes makes it again.
VERSIONS = {known.format: known.version for known in (*SCHEMAS, *RECORDS)}
VERSIONS[vortex_table.FORMAT] = vortex_table.VERSION
# The stages of piv/ know nothing of scenes: they get their own flags, by name, as a settings file.
FLAT_SETTINGS: dict[str, Callable[[Scene], dict[str, Any]]] = {
    "images": lambda scene: render_settings(scene.camera, scene.sheet),
    "piv": lambda scene: piv_settings(scene.piv, scene.camera),
    "vortices": lambda scene: scene.vortices.model_dump(mode="json"),
}


def _file_digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()[:16] if path.exists() else "missing"


def settings_of(scene: Scene, stage: str) -> dict[str, Any]:
    """The part of the scene that a stage's results depend on, with the digests of the files it names or is written from."""
    if stage in FLAT_SETTINGS:
        return FLAT_SETTINGS[stage](scene)
    settings = scene.model_dump(mode="json", include=STAGE_SECTIONS[stage])
    if stage == "kinematics":
        named = [getattr(scene.motion, key) for key in sorted(FILE_KEYS)]
        settings["files"] = {name: _file_digest(scene.folder / name) for name in named if name}
    if stage == "case":
        settings["templates"] = templates_digest()
    return settings


def changed_settings(scene: Scene) -> dict[str, str]:
    """Text of each file in `settings/`, numbers and formats of the stages, that is missing or says otherwise."""
    texts = {
        f"{stage}.json": json.dumps(settings_of(scene, stage), indent=1, sort_keys=True) + "\n"
        for stage in STAGE_SECTIONS
    }
    texts |= {
        f"{s.target}.format": f"{s.format} {VERSIONS[s.format]}\n" for s in STAGES if s.format
    }
    changes = {}
    for name, text in texts.items():
        path = scene.out / "settings" / name
        if not path.exists() or _said(name, path.read_text(encoding="utf-8")) != _said(name, text):
            changes[name] = text
    return changes


def _said(name: str, text: str) -> Any:
    """What a file of settings says; of sections of the scene without their keys that are null, so that a new key begins nothing anew."""
    stage, _, kind = name.partition(".")
    if kind == "json" and stage not in FLAT_SETTINGS:
        with contextlib.suppress(StageError):  # what is damaged is written anew
            return given(parse_json(text, name, ""))
    return text


def write_settings(scene: Scene) -> list[str]:
    """Write the files of `settings/` whose content changed; returns the names of the stages that changed."""
    changed = changed_settings(scene)
    folder = scene.out / "settings"
    with checksums_of([folder]):
        for name, text in changed.items():
            write_text(folder / name, text)
    return list(dict.fromkeys(name.partition(".")[0] for name in changed))


def make_rules(scene: Scene) -> str:
    """What tells make that settings/.stamp follows from every scene.toml and file of the motion that the scene is made of.

    Each is also a target of nothing, so that make does not stop where one is gone since. The comparison of a pinch follows
    from the vortices of the single finger that it extends, at its level and where that was run.
    """
    scenes = [layer.path for layer in read_layers(scene.folder / "scene.toml")]
    motion = [scene.folder / name for name in settings_of(scene, "kinematics")["files"]]
    sources = [_make_name(path) for path in (*scenes, *motion)]
    lines = [f"{_make_name(scene.out / 'settings' / '.stamp')}: {' '.join(sources)}"]
    lines += [f"{name}:" for name in sources]
    if scene.pinch is not None and len(scenes) > 1:
        single = _make_name(scenes[0].parent / "out" / scene.level)
        done = _make_name(scene.out / BY_NAME["compare"].done)
        lines.append(f"{done}: $(wildcard {single}/vortices_*.csv)")
    return "\n".join(lines) + "\n"


def _make_name(path: Path) -> str:
    return re.sub(r"([\s#:%])", r"\\\1", os.path.normpath(path)).replace("$", "$$")


def update_settings(scene: Scene, quiet: bool = False, fea_follows: bool = False) -> None:
    """Write settings/*.json and, for make, settings/.files.mk; touch settings/.stamp.

    StageError where the scene's bending states are another actuator's, unless `fea_follows`, which will make them.
    """
    if not fea_follows:
        check_states(scene)
    folder = scene.out / "settings"
    folder.mkdir(parents=True, exist_ok=True)
    first = not (folder / ".stamp").exists()
    with exclusive(folder / ".stamp", wait=True):
        # a stage that began with the old numbers would otherwise end later than the new ones, and pass for made of them
        if changed_settings(scene) and (stage := held(scene.out)):
            raise StageError(
                f"{scene.out}: the scene has changed while another make is at work here ({stage}); wait for it or stop it"
            )
        changed = write_settings(scene)
        write_text(folder / ".files.mk", make_rules(scene))
        (folder / ".stamp").touch()
    if quiet:
        return
    if replaced := resolve(scene.folder / "scene.toml", scene.level)[1]:
        told = ", ".join(f"{key} of {path}" for key, path in sorted(replaced.items()))
        print(f"settings: {told} holds in place of the parent's [levels.{scene.level}]")
    for remark in scene.remarks():
        print(f"settings: {remark}")
    if changed and not first:
        print(f"settings: {', '.join(changed)} changed in {scene.folder} at level {scene.level}")


def run(args: argparse.Namespace) -> None:
    """Command `settings`."""
    update_settings(load_scene(args.scene, args.level), args.quiet)
