"""Pressure and structure told apart in pictures of a finger that water bends; the water is the modelled one, on both sides."""

import numpy as np
import pytest

from fileio.formats.elastic_motion import write_elastic_motion
from fileio.formats.finger_loads import write_loads
from fileio.formats.kinematics import read_kinematics, write_kinematics
from fileio.formats.recording import RecordingWriter
from pipeline.kinematics.stage import kinematics_values
from pipeline.scene.scene import load_scene
from pipeline.stage_settings import settings_of
from pipeline.structure.coupling import motion_values
from pipeline.study.couple import Structure
from postprocess.evidence.stage_files import StageFiles
from postprocess.lab.data.dpiv_toml import read_dpiv
from postprocess.lab.data.files import LabFiles
from postprocess.lab.judgement.causes import causes, write_modelled, write_scene
from postprocess.lab.registration import step
from postprocess.lab.virtual.virtual_laboratory import write_dpiv
from tests.lab_scene import CASE, set_up, still_picture

START, RATE = 0.006, 60.0  # s of the motion at the first picture; Hz
STATED = 'start = { at_s = 0.0055, std_s = 0.001 }\npressure = { csv = "p.csv", std_kpa = 0.1 }'
MOVED = 'extends = "../.."\n[motion]\nsource = "structure"\nshapes = "elastic_motion.h5"\n'


def kinematics_of(folder):
    scene = load_scene(folder, "smoke")
    path = scene.out / "kinematics.h5"
    path.parent.mkdir(parents=True, exist_ok=True)
    write_kinematics(path, kinematics_values(scene), settings_of(scene, "kinematics"))
    return read_kinematics(path)


def coupled(folder):
    """Run 1 of a scene's coupled motion, under the modelled water: its structure and its folder."""
    structure = Structure(load_scene(folder, "smoke"))
    delta = structure.first()
    run = folder / "out" / "coupled" / "smoke_1"
    (run / "out" / "smoke").mkdir(parents=True)
    bend = structure.chain.bend(structure.pressure, delta)
    write_loads(run / "out" / "smoke", {"step": structure.time, "bend": bend, "unknown": ""}, {})
    values = motion_values(structure.chain, structure.time, structure.pressure, delta, None)
    for name in ("elastic_motion.h5", "after.h5"):  # nothing is left to change
        write_elastic_motion(run / name, values | {"made_of": ""})
    return structure, run


def recorded(folder, differs):
    """Pictures and pressure of a finger that differs from the scene's in some lines of scene.toml."""
    (folder / "truth").mkdir(parents=True)
    (folder / "truth" / "scene.toml").write_text(f'extends = "{CASE}"\n{differs}')
    structure, run = coupled(folder / "truth")
    (run / "scene.toml").write_text(MOVED.replace("../..", "../../.."))
    kinematics = kinematics_of(run)
    lab, data = set_up(kinematics, start=START), folder / "recorded"
    times = np.arange(START, 0.42, 1 / RATE)
    shape = lab.camera.height_px, lab.camera.width_px
    data.mkdir()
    with RecordingWriter(
        data / "recording.h5", shape, np.uint8, times.size, {"bits": 8, "frame_rate_hz": RATE}
    ) as writer:
        for i, time in enumerate(times):
            writer.write(i, still_picture(kinematics, lab, float(kinematics.law(time)), i))
        writer.finish()
    write_dpiv(lab, kinematics.root, data, "truth", 24, 8, None, 1)
    text = (data / "dpiv.toml").read_text().replace('start = "from motion"', STATED)
    (data / "dpiv.toml").write_text(
        text.replace("frame_rate_hz = 500.0", f"frame_rate_hz = {RATE}")
    )
    clock = np.arange(-0.02, 0.44, 1e-3)
    noise = 100 * np.random.default_rng(2).standard_normal(clock.size)
    rows = zip(
        clock - START, np.interp(clock, structure.time, structure.pressure) + noise, strict=True
    )
    (data / "p.csv").write_text("t,p\n" + "".join(f"{t:.6f},{p:.3f}\n" for t, p in rows))
    return read_dpiv(data)


@pytest.mark.parametrize(
    "differs, words",
    [
        ("[motion]\nstrokes = [{ pressure_kpa = 18.0, start = 0.005, duration = 0.4 }]\n", ["differs", "agrees"]),
        ("[structure]\nbending_stiffness = 0.6e-3\n", ["agrees", "model error"]),  # a quarter as much again
    ],
)  # fmt: skip
def test_pressure_and_structure_are_told_apart(tmp_path, monkeypatch, differs, words):
    """The finger bends to 98°, and the scene's prescribed one to 87°: against that one no registration is accepted."""
    monkeypatch.setattr(step, "SWEEPS", step.QUICK_SWEEPS)
    dpiv = recorded(tmp_path, differs)
    case = tmp_path / "finger"
    (case / "reference").mkdir(parents=True)
    (case / "scene.toml").write_text(f'extends = "{CASE}"\n')
    inputs = 'format = "inputs"\nformat_version = 1\ntoo_uncertain = 0.3\n'
    (case / "reference" / "inputs.toml").write_text(inputs)
    kinematics_of(case)
    files = LabFiles(StageFiles(case, "smoke"), dpiv.name)
    coupled(write_scene(files, dpiv))
    kinematics_of(write_modelled(files, dpiv))
    modelled = files.of_scene("modelled")
    modelled.folder.mkdir(parents=True)
    step.run_registration(modelled, dpiv)
    table = causes(files, dpiv)
    assert list(table.verdict[:2]) == words
    # the wrong one is far beyond its band, the right one within it: no verdict hangs on a hair
    assert sorted(table.difference[:2] / table.band[:2] > 1.5) == [False, True]
