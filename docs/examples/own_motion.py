"""A finger that follows a pressure of your own: sine, one second long."""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from pipeline.formats.kinematics import read_kinematics
from pipeline.runs.run import open_run
from softfinger.make import Machine, make

scene = Path("cases/own_motion")
scene.mkdir(exist_ok=True)
time = np.linspace(0, 1, 101)
rows = np.column_stack([time, 8000 * (1 - np.cos(2 * np.pi * time))])
np.savetxt(scene / "p.csv", rows, "%.6g", ",", header="t,p", comments="")
text = 'extends = "../single_finger"\n[motion]\npressure_csv = "p.csv"\nend_time = 1.0\n'
(scene / "scene.toml").write_text(text + 'states = "../single_finger/kinematics/states.h5"\n')
run = open_run(scene, "smoke")
make(run, "kinematics", Machine(), quiet=True)
motion = read_kinematics(run.path("kinematics"))
plt.plot(time, np.degrees(motion.shape("bend", motion.law(time))))
plt.xlabel("time, s")
plt.ylabel("bend, deg")
plt.savefig("own_motion.png", dpi=120)
