"""Stage settings: the scene resolved for one level, one small file per stage that changes only if its content does."""

from __future__ import annotations

import json
import re

from pipeline.analysed import check_states
from pipeline.errors import StageError
from pipeline.scene import STAGE_SECTIONS, Scene
from pipeline.scene_file import scene_files
from pipeline.stage import guarded, parser, write_text
from piv.exclusive import exclusive, held


def changed_settings(scene: Scene) -> dict[str, str]:
    """Text of `settings/<stage>.json` for each stage whose file is missing or says otherwise."""
    found = {}
    for stage in STAGE_SECTIONS:
        path = scene.out / "settings" / f"{stage}.json"
        text = json.dumps(scene.settings(stage), indent=1, sort_keys=True) + "\n"
        if not path.exists() or path.read_text(encoding="utf-8") != text:
            found[stage] = text
    return found


def write_settings(scene: Scene) -> list[str]:
    """Write `settings/<stage>.json` where its content changed; returns the names of the stages that changed."""
    changed = changed_settings(scene)
    for stage, text in changed.items():
        write_text(scene.out / "settings" / f"{stage}.json", text)
    return list(changed)


def make_rules(scene: Scene) -> str:
    """What tells make that settings/.stamp follows from every scene.toml and file of the motion that the scene is made of.

    Each is also a target of nothing, so that make does not stop where one is gone since.
    """
    motion = [scene.folder / name for name in scene.settings("kinematics")["files"]]
    names = [re.sub(r"([\s#:%])", r"\\\1", str(path)).replace("$", "$$") for path in
             (scene.out / "settings" / ".stamp", *scene_files(scene.folder / "scene.toml"), *motion)]  # fmt: skip
    return f"{names[0]}: {' '.join(names[1:])}\n" + "".join(f"{name}:\n" for name in names[1:])


def run(scene: Scene, quiet: bool = False, fea_follows: bool = False) -> None:
    """Write settings/*.json and, for make, settings/.files.mk; touch settings/.stamp.

    StageError where the scene's bending states are another actuator's, unless `fea_follows`, which will make them.
    """
    if not fea_follows:
        check_states(scene)
    folder = scene.out / "settings"
    folder.mkdir(parents=True, exist_ok=True)
    with exclusive(folder / ".stamp", wait=True):
        # a stage that began with the old numbers would otherwise end later than the new ones, and pass for made of them
        if changed_settings(scene) and (stage := held(scene.out)):
            raise StageError(
                f"{scene.out}: the scene has changed while another make is at work here ({stage}); wait for it or stop it"
            )
        changed = write_settings(scene)
        write_text(folder / ".files.mk", make_rules(scene))
        (folder / ".stamp").touch()
    if changed and not quiet:
        print(f"settings: {', '.join(changed)} changed in {scene.folder} at level {scene.level}")


if __name__ == "__main__":
    from pipeline.scene import load_scene

    args = parser("settings", __doc__).parse_args()
    guarded("settings", lambda: run(load_scene(args.scene, args.level), args.quiet))
