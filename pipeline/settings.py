"""Stage settings: the scene resolved for one level, one small file per stage that changes only if its content does."""

from __future__ import annotations

from pipeline.errors import StageError
from pipeline.scene import Scene, changed_settings, write_settings
from pipeline.stage import guarded, parser
from piv.exclusive import exclusive, held


def run(scene: Scene, quiet: bool = False) -> None:
    """Write settings/*.json and touch settings/.stamp."""
    folder = scene.out / "settings"
    folder.mkdir(parents=True, exist_ok=True)
    with exclusive(folder / ".stamp", wait=True):
        # a stage that began with the old numbers would otherwise end later than the new ones, and pass for made of them
        if changed_settings(scene) and (stage := held(scene.out)):
            raise StageError(
                f"{scene.out}: the scene has changed while another make is at work here ({stage}); wait for it or stop it"
            )
        changed = write_settings(scene)
        (folder / ".stamp").touch()
    if changed and not quiet:
        print(f"settings: {', '.join(changed)} changed in {scene.folder} at level {scene.level}")


if __name__ == "__main__":
    from pipeline.scene import load_scene

    args = parser("settings", __doc__).parse_args()
    guarded("settings", lambda: run(load_scene(args.scene, args.level), args.quiet))
