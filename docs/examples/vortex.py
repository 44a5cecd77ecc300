"""The vortex beside a finger: its centre, core and circulation."""

import matplotlib.pyplot as plt
import numpy as np
from PIL import Image

from piv import correlate_pair, find_vortices

a, b = (np.asarray(Image.open(f"docs/tutorials/frames/frame_{k}.png")) for k in (0, 1))
field = correlate_pair(a, b, window=24, spacing=8)
vorticity = field["v"].differentiate("x") - field["u"].differentiate("y")
vorticity.plot(cmap="PuOr_r", cbar_kwargs={"label": "vorticity, 1/frame"})
strongest = find_vortices(field)[0]
plt.plot(strongest.x, strongest.y, "k+", markersize=14)
plt.title(f"circulation {strongest.circulation:.0f} px² per frame")
plt.xlabel("x, px")
plt.ylabel("y, px")
plt.savefig("vortex.png", dpi=120)
