"""Stage kinematics of a coupled run: a first guess of the motion, under modelled water.

Its meshes are built for the guess, and follow the motion that the solver's loads make.
"""

from pipeline.kinematics.values import kinematics_values, motion_sentences, write_motion
from pipeline.scene.scene import Scene
from pipeline.structure.finger import modelled_shapes


def run(scene: Scene, quiet: bool = False) -> None:
    """Write kinematics.h5."""
    values = kinematics_values(scene, modelled_shapes(scene))
    write_motion(scene, scene.out, values)
    if not quiet:
        print("\n".join(motion_sentences(scene, values)))
