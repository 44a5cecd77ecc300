"""The flow in the laser sheet of a run at one instant, with PIV's vectors over it."""

from pathlib import Path

import matplotlib.pyplot as plt

from piv import read_plane

out = Path("cases/single_finger/out/smoke")
sheet, piv = (
    read_plane(out / name).sel(time=0.2, method="nearest") for name in ("sheet.h5", "piv.h5")
)
vorticity = sheet["v"].differentiate("x") - sheet["u"].differentiate("y")
vorticity.plot(cmap="PuOr_r", robust=True, cbar_kwargs={"label": "vorticity, 1/s"})
some = piv.isel(x=slice(None, None, 2), y=slice(None, None, 2))
plt.quiver(some["x"], some["y"], some["u"], some["v"])
plt.fill(*sheet["outline"].values[0].T, color="0.5")
plt.title(f"{float(sheet['time']):.3f} s")
plt.savefig("field_at_an_instant.png", dpi=120)
