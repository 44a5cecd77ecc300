"""The simulation driven by the recording's own motion: motion.h5 and the scene `measured/` that reads it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from fileio.atomic import write_text
from fileio.checksum import sha256
from fileio.formats.kinematics import read_kinematics
from fileio.formats.recorded_motion import write_recorded_motion
from fileio.key_reference import toml_value
from postprocess.evidence.stage_files import scene_title
from postprocess.lab.data.dpiv_toml import NAME, Dpiv
from postprocess.lab.data.files import LabFiles, read_registration
from postprocess.lab.data.inputs_toml import read_inputs
from postprocess.lab.data.pictures import LabRecording, thinned
from postprocess.lab.registration.blind import blind_parts
from postprocess.lab.registration.fit_outline import prepare
from postprocess.lab.registration.outline_profile import seen_outlines
from postprocess.lab.registration.profile import fit_profile, motion_values, strip_at_rest
from postprocess.lab.registration.register import LEARN_FROM, MAX_FRAMES
from postprocess.lab.registration.silhouette import learn

SCENE = """# Written by postprocess.lab: the scene driven by a motion, for the recording {name}.
extends = "../../../../.."
title = {title}

[motion]
source = "recording"
recording = "../{motion}"
strokes = []
"""
INPUTS = """# Written by postprocess.lab: what is not known of the motion, and the numerics of the nominal scene.
format = "inputs"
format_version = 1
too_uncertain = {too_uncertain!r}

[[input]]
name = "pressure"
key = "motion.recording_factor"
step = 0.02
limit = {limit!r}
reason = "{reason}, √3 standard deviations."
{numerics}"""


def run_motion(files: LabFiles, dpiv: Dpiv) -> Path:
    """Measure the lower layer in every frame that is used, write motion.h5 and the scene; returns the scene's folder."""
    if dpiv.kind != "pictures":
        raise ValueError(
            f"{dpiv.folder / NAME}: vectors do not show the finger; its motion can be measured from pictures only"
        )
    kinematics = read_kinematics(files.stage.required("kinematics.h5", "kinematics"))
    registration = read_registration(files.registration)
    law, pose = registration.law, registration.pose
    strip = strip_at_rest(kinematics)
    with LabRecording(dpiv) as recording:
        at = recording.times - law.delay
        inside = np.flatnonzero((at >= kinematics.time[0] - 0.02) & (at <= kinematics.time[1]))
        chosen = thinned(inside, MAX_FRAMES)
        images = [recording.frame(int(i)) for i in chosen]
    guesses = np.interp(at[chosen], registration.times - law.delay, registration.pressures)
    outlines = seen_outlines(kinematics, pose, guesses, registration.nuisance.values)
    blind = blind_parts(
        outlines, pose, kinematics, images[0].shape, dpiv.root_hidden_mm * 1e-3, dpiv.light_from
    )
    frames = prepare(images, at[chosen], learn(images[:: max(1, len(images) // LEARN_FROM)]), blind)
    start = float(kinematics.law(kinematics.time[0]))
    bends = kinematics.bend(np.where(frames.times <= 0, start, guesses))
    known = strip, pose, registration.nuisance.values
    fits = [
        fit_profile(integral, frames.mean, *known, float(bend), frames.independent)
        for integral, bend in zip(frames.integrals, bends, strict=True)
    ]
    shapes = np.array(fits)
    values: dict[str, Any] = motion_values(
        kinematics, strip, frames.times, shapes, kinematics.time[1]
    )
    values |= {"recording": dpiv.title, "dpiv_sha256": sha256(dpiv.folder / NAME)}
    values["registration"] = json.dumps(
        {"delay": law.delay, "scale_m_per_px": pose.scale_m_per_px, "angle": pose.angle}
    )
    write_recorded_motion(files.motion, values)
    return write_moved_scene(
        files,
        dpiv,
        "measured",
        f"moved as in the recording {dpiv.name}",
        files.motion.name,
        float(registration.law.std("factor")),
        "Uncertainty of the bending as the silhouette shows it",
    )


def write_moved_scene(
    files: LabFiles, dpiv: Dpiv, name: str, about: str, motion: str, factor_std: float, reason: str
) -> Path:
    """Write the scene `name`, driven by the file `motion` of the format of motion.h5 beside it; returns its folder.

    `factor_std`: standard uncertainty of the motion over itself, of the `reason`; `about`: for its title.
    """
    folder = files.folder / name
    inputs = read_inputs(files.stage.scene_folder / "reference" / "inputs.toml")
    numerics = "".join(
        f'\n[[numerics]]\nname = "{n.name}"\nratio = {n.ratio!r}\norder = {n.order!r}\nsafety = {n.safety!r}\n'
        for n in inputs.numerics
    )
    title = toml_value(f"{scene_title(files.stage.scene_folder)}, {about}")
    write_text(folder / "scene.toml", SCENE.format(name=dpiv.name, title=title, motion=motion))
    limit = round(3**0.5 * factor_std, 6)
    text = INPUTS.format(
        too_uncertain=inputs.too_uncertain, limit=limit, reason=reason, numerics=numerics
    )
    write_text(folder / "reference" / "inputs.toml", text)
    findings = files.stage.findings
    if findings.exists():
        write_text(folder / "reference" / "findings.toml", findings.read_text(encoding="utf-8"))
    return folder
