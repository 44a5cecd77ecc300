"""The step `register`: find the finger in pictures, or take what is stated of vectors."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from fileio.atomic import sha256, write_bytes
from fileio.errors import StageError
from fileio.formats.kinematics import Kinematics
from postprocess.lab.data.dpiv_toml import NAME, Dpiv, Start
from postprocess.lab.data.files import LabFiles, Law, Registration, write_registration
from postprocess.lab.data.pictures import LabRecording, stated_pose
from postprocess.lab.data.pose import Pose
from postprocess.lab.data.vectors import vectors_view
from postprocess.lab.registration.check_fit import check_fit, draw_fit
from postprocess.lab.registration.register import TURN_STD, Known, register

VIEW_MARGIN = 0.008  # m of the sheet beyond the picture


def run_registration(
    files: LabFiles, dpiv: Dpiv, kinematics: Kinematics, seed: int = 1
) -> Registration:
    """Register the data and write registration.json."""
    _check_bend(kinematics, files.stage.out / "kinematics.h5")
    if dpiv.kind == "vectors":
        registration = stated_registration(dpiv, kinematics)
        corners = vectors_view(dpiv)
    else:
        with LabRecording(dpiv) as recording:
            registration = _of_pictures(files, dpiv, recording, kinematics, seed)
            corners = (0.0, 0.0), (float(recording.shape[1]), float(recording.shape[0]))
    registration = replace(registration, view=registration.pose.view(*corners, VIEW_MARGIN))
    made_of = {"dpiv_sha256": sha256(dpiv.folder / NAME), "seed": seed}
    write_registration(registration, files.registration, **made_of)
    return registration


def _of_pictures(
    files: LabFiles, dpiv: Dpiv, recording: LabRecording, kinematics: Kinematics, seed: int
) -> Registration:
    turn = dpiv.axes.turn_std_deg
    known = Known(
        stated_pose(dpiv, recording, kinematics.root),
        dpiv.scale.std_percent / 100,
        turn_std=TURN_STD if turn is None else float(np.radians(turn)),
        delay=(-dpiv.start.at_s, dpiv.start.std_s) if isinstance(dpiv.start, Start) else None,
        paired=dpiv.piv.pairing == "1-2,3-4",
        hidden=dpiv.root_hidden_mm * 1e-3,
        light_from=dpiv.light_from,
        length_std=(dpiv.finger_length_std_mm or 0.0) * 1e-3 / kinematics.length,
    )
    try:
        registration = register(recording, recording.times, kinematics, known, seed)
    except StageError as error:
        raise StageError(f"{dpiv.folder / NAME}: {error}") from error
    check = check_fit(recording, registration, kinematics, known)
    files.refused.unlink(missing_ok=True)
    if check.refusals:
        files.registration.unlink(missing_ok=True)  # of other pictures, perhaps
        write_bytes(files.refused, draw_fit(check))
        text = f"the registration is refused: {'; also, '.join(check.refusals)}"
        raise StageError(f"{dpiv.folder / NAME}: {text}; see {files.refused}")
    return registration


def _check_bend(kinematics: Kinematics, path: Path) -> None:
    """StageError where one bend angle belongs to several shapes."""
    change = np.diff(kinematics.data["shape_bend"].values)
    if not (np.all(change > 0) or np.all(change < 0)):
        raise StageError(
            f"{path}: shape_bend neither rises nor falls from shape to shape, as of a coupled"
            " motion or a rigid body, so a recording's bend does not tell the shape; compare a"
            " scene whose motion.source is 'fea' or 'paper_equations'"
        )


def fea_band(files: LabFiles, dpiv: Dpiv, kinematics: Kinematics) -> float:
    """Standard uncertainty (rad) of the final bend by the bands of the FEA; 0: they do not count.

    StageError where they count and are not known.
    """
    if dpiv.finger_geometry == "measured":
        return 0.0
    bend_std = kinematics.bend_std(float(kinematics.law(kinematics.time[1]))) or 0.0
    if bend_std == 0:
        raise StageError(
            f"{files.stage.out / 'kinematics.h5'}: carries no state_bend_std, so the bands of the"
            ' FEA are not known; run make fea, or state finger_geometry = "measured" in dpiv.toml'
        )
    return bend_std


def stated_registration(dpiv: Dpiv, kinematics: Kinematics) -> Registration:
    """The registration of vectors as stated; the picture's unit is the stated metre."""
    axes, start = dpiv.axes, dpiv.start
    assert isinstance(start, Start)
    assert axes.root_mm
    assert axes.root_std_mm
    assert axes.turn_std_deg is not None
    x, y = np.array(axes.root_mm) * 1e-3
    at = float(-x if axes.x == "left" else x), float(y)
    root_std, turn_std = axes.root_std_mm * 1e-3, float(np.radians(axes.turn_std_deg))
    covariance = np.diag([root_std, root_std, turn_std, dpiv.scale.std_percent / 100]) ** 2
    pose = Pose(1e3, float(np.radians(axes.turn_deg)), kinematics.root, at)
    law = Law(np.array([1.0, -start.at_s, 1.0]), np.diag([0.0, start.std_s**2, 0.0]), 0.0)
    none = np.empty(0)
    return Registration(pose, covariance, 0.0, law, none, none, none, pose)


def registration_summary(registration: Registration) -> dict[str, Any]:
    """The values found, and their differences from the stated ones, in a laboratory's units."""
    pose, law, stated = registration.pose, registration.law, registration.stated
    std = np.sqrt(np.diag(registration.covariance))
    scale = pose.scale_mm_per_px
    off = (np.asarray(pose.at_px) - stated.at_px) * scale
    return {
        "scale_mm_per_px": scale,
        "scale_std_percent": 100 * float(std[3]),
        "turn_deg": float(np.degrees(pose.angle)),
        "turn_std_deg": float(np.degrees(std[2])),
        "root_px": pose.at_px,
        "root_std_mm": [float(s) * scale for s in std[:2]],
        "delay_ms": law.delay * 1e3,
        "delay_std_ms": law.std("delay") * 1e3,
        "pressure_factor": float(law.values[0]),
        "pressure_factor_std": law.std("factor"),
        "stretch": float(law.values[2]),
        "stretch_std": law.std("stretch"),
        "scale_against_stated_percent": 100 * (scale / stated.scale_mm_per_px - 1),
        "turn_against_stated_deg": float(np.degrees(pose.angle - stated.angle)),
        "root_against_stated_mm": [float(v) for v in off],
    }
