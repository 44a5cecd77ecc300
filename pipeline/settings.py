"""Stage settings: the scene resolved for one level, one small file per stage that changes only if its content does."""

from __future__ import annotations

from pipeline.scene import Scene, write_settings
from pipeline.stage import guarded, parser
from piv.exclusive import exclusive


def run(scene: Scene, quiet: bool = False) -> None:
    """Write settings/*.json and touch settings/.stamp."""
    folder = scene.out / "settings"
    folder.mkdir(parents=True, exist_ok=True)
    with exclusive(folder, wait=True):
        changed = write_settings(scene)
        (folder / ".stamp").touch()
    if changed and not quiet:
        print(f"settings: {', '.join(changed)} changed in {scene.folder} at level {scene.level}")


if __name__ == "__main__":
    from pipeline.scene import load_scene

    args = parser("settings", __doc__).parse_args()
    guarded("settings", lambda: run(load_scene(args.scene, args.level), args.quiet))
