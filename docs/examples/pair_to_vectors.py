"""Vectors of two pictures, drawn over the first one."""

import matplotlib.pyplot as plt
import numpy as np
from PIL import Image

from piv import correlate_pair

a, b = (np.asarray(Image.open(f"docs/tutorials/frames/frame_{k}.png")) for k in (0, 1))
field = correlate_pair(a, b, window=24, spacing=8)  # u, v in px per frame, y up
seen = field.where(field["valid"] == 1)
rows = a.shape[0]
plt.imshow(a, cmap="gray", extent=(-0.5, a.shape[1] - 0.5, -0.5, rows - 0.5))
plt.quiver(seen["x"], seen["y"], seen["u"], seen["v"], color="orange")
plt.xlabel("x, px")
plt.ylabel("y, px")
plt.savefig("pair_to_vectors.png", dpi=120)
