"""Shapes of another program's finger, here arcs of a circle, as the motion of a scene."""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from pipeline.formats.kinematics import read_kinematics
from pipeline.runs.run import open_run
from softfinger.make import Machine, make

scene = Path("cases/imported")
scene.mkdir(exist_ok=True)
s, rows = np.linspace(0, 0.07, 71), []
for pressure_kpa in range(0, 25, 2):
    k = max(pressure_kpa * 0.8, 1e-6)  # curvature, 1/m; the finger bends to -y
    arc = np.column_stack([np.sin(k * s) / k, (np.cos(k * s) - 1) / k])
    rows += [(pressure_kpa, a, *place) for a, place in zip(s, arc, strict=True)]
np.savetxt(scene / "curves.csv", rows, "%.8g", ",", header="pressure_kpa,s,x,y", comments="")
text = 'extends = "../single_finger"\n[motion]\nstates = "curves.csv"\n'
(scene / "scene.toml").write_text(text)
run = open_run(scene, "smoke")
make(run, "kinematics", Machine(), quiet=True)
for outline in read_kinematics(run.path("kinematics")).data["shape_outline"].values[::8]:
    plt.plot(*outline.T)
plt.axis("equal")
plt.xlabel("x, m")
plt.ylabel("y, m")
plt.savefig("import_shapes.png", dpi=120)
