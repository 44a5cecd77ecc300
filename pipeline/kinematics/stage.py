"""Stage kinematics: the pressure law and the finger's shapes, written to kinematics.h5."""

from pipeline.kinematics.values import kinematics_values, motion_sentences, write_motion
from pipeline.scene.scene import Scene


def run(scene: Scene, quiet: bool = False) -> None:
    """Write kinematics.h5."""
    values = kinematics_values(scene)
    write_motion(scene, scene.out, values)
    if not quiet:
        print("\n".join(motion_sentences(scene, values)))
