"""A scene with five durations of its stroke: the speed of the finger's tip."""

from pathlib import Path

import matplotlib.pyplot as plt

from pipeline.formats.kinematics import read_kinematics
from pipeline.runs.run import open_run
from softfinger.make import Machine, make

durations, speeds = (0.2, 0.3, 0.4, 0.5, 0.6), []
for duration in durations:
    stroke = {"pressure_kpa": 20.0, "start": 0.005, "duration": duration}
    overrides = {"motion.strokes": [stroke], "motion.end_time": duration}
    out = Path(f"durations/{duration:g}").resolve()
    run = open_run("cases/single_finger", "smoke", overrides, out)
    make(run, "kinematics", Machine(), quiet=True)
    speeds.append(read_kinematics(run.path("kinematics")).data.attrs["peak_tip_speed"])
plt.plot(durations, speeds, "o-")
plt.xlabel("duration of the stroke, s")
plt.ylabel("largest speed of the tip, m/s")
plt.savefig("scene_over_values.png", dpi=120)
