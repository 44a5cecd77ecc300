"""Stage kinematics: the pressure law and the finger's shapes, written to kinematics.h5.

Of a coupled run they are a first guess, under modelled water, for its meshes.
"""

import numpy as np
from scipy.interpolate import CubicSpline

from pipeline.formats.kinematics import write_kinematics
from pipeline.kinematics.contact import closing_sentence
from pipeline.kinematics.finger import clipping
from pipeline.kinematics.pressure_law import absolute
from pipeline.kinematics.values import kinematics_values, units_of
from pipeline.scene.scene import Scene

_JUMP = 0.05  # of the peak rate: a motion that starts with more starts impulsively


def run(scene: Scene, quiet: bool = False) -> None:
    """Write kinematics.h5."""
    shapes = None
    if scene.coupled:
        from pipeline.structure.finger import modelled_shapes

        shapes = modelled_shapes(scene)
    values = kinematics_values(scene, shapes)
    write_kinematics(scene.out / "kinematics.h5", values, units=units_of(scene, values))
    if not quiet and scene.body:
        print(f"kinematics: a {scene.body.shape} in {len(values['shape_parameter'])} places")
    elif not quiet:
        bend = np.degrees(values["shape_bend"])
        print(
            f"kinematics: {bend.min():.1f}° … {bend.max():.1f}° of bend in {len(bend)} shapes,"
            f" tip ≤ {values['peak_tip_speed']:.3f} m/s"
        )
        rate = np.abs(CubicSpline(values["time"], values["pressure"])(values["time"], 1))
        if rate[0] > _JUMP * rate.max():
            print(
                f"kinematics: warning: {scene.motion.pressure_csv or scene.motion.recording} begins"
                " with a jump of its slope: the first peak of force is that of an impulsive start;"
                " give motion.smoothing, or rows of rest before"
            )
        table = scene.motion.pressure_csv
        beyond = clipping(scene.motion, scene.finger, scene.folder)
        for remark in (beyond, absolute(scene.folder / table) if table else ""):
            print(f"kinematics: warning: {remark}") if remark else None
        if scene.pinch is not None:
            print(f"kinematics: {closing_sentence(values)}")
