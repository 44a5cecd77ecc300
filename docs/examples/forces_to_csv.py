"""The force of the water on the finger, as a table and as a curve."""

from pathlib import Path

import matplotlib.pyplot as plt

from pipeline.formats.records import FORCES

forces = FORCES.read(Path("cases/single_finger/out/smoke/run/forces.csv"))
print(forces.columns.tolist())
forces.to_csv("forces.csv", index=False)
forces.plot(x="time", y=["fx", "fy"])
plt.xlabel("time, s")
plt.ylabel("force, N")
plt.savefig("forces_to_csv.png", dpi=120)
