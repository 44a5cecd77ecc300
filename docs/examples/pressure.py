"""Pressure of the water from the vectors of a film with a scale and a clock."""

import subprocess
import sys

import matplotlib.pyplot as plt

from piv import pressure, read_plane

settings = "--window 24 --spacing 8 --rate 500 --scale-mm-per-px 0.1 --mask masks"
for command in (
    "mask docs/tutorials/frames --dark -o masks",
    f"correlate docs/tutorials/frames -o series.h5 {settings}",
):
    subprocess.run([sys.executable, "-m", "piv", *command.split()], check=True)
found = pressure(read_plane("series.h5").load())
p = found["p"].isel(time=2).assign_coords(x=1e3 * found["x"], y=1e3 * found["y"])
p.plot(cmap="RdBu_r", cbar_kwargs={"label": "pressure, Pa"})
plt.xlabel("x, mm")
plt.ylabel("y, mm")
plt.savefig("pressure.png", dpi=120)
