"""Picture of docs/vortices.md: python -m tests.studies.pictures.vortices docs/vortices.png (repository root)."""

import sys

import matplotlib.pyplot as plt
import numpy as np

from piv.plots.vectors import COLOUR_MAP
from piv.vortices.criteria import gradients, vorticity
from piv.vortices.find import find_vortices
from piv.vortices.gamma2 import gamma2
from tests.analytic.piv.tip_scene import tip_scene


def main(path: str) -> None:
    """Tip vortex on a CFD grid and on a PIV grid: vorticity, Gamma2 region, fitted core."""
    scenes = (
        ("CFD grid, 0.5 mm", tip_scene(0.5e-3, 5e-3, 1.5)),
        ("PIV-like, 1 mm, filtered, noisy", tip_scene(1e-3, 5e-3, 1.5, blur=0.8e-3, noise=2e-3)),
    )
    figure, axes = plt.subplots(1, 2, figsize=(10, 5), layout="constrained", sharey=True)
    for axis, (title, (plane, centre)) in zip(axes, scenes, strict=True):
        x, y, u, v = (plane[n].values for n in ("x", "y", "u", "v"))
        valid = plane["valid"].values != 0
        step = x[1] - x[0]
        omega = vorticity(gradients(u, v, valid, step, step))
        region = np.nan_to_num(np.abs(gamma2(u, v, valid, step, step, 2e-3)))
        axis.pcolormesh(x * 1e3, y * 1e3, omega, cmap=COLOUR_MAP, vmin=-150, vmax=150)
        axis.contour(x * 1e3, y * 1e3, region, [2 / np.pi], colors="tab:green")
        k = round(2e-3 / step)
        axis.quiver(x[::k] * 1e3, y[::k] * 1e3, u[::k, ::k], v[::k, ::k], scale=8, width=2e-3)
        for w in find_vortices(plane):
            axis.add_patch(
                plt.Circle((w.x * 1e3, w.y * 1e3), w.core_radius * 1e3, fill=False, lw=2)
            )
            axis.annotate(
                f"{w.circulation * 1e4:.0f} ± {w.circulation_std * 1e4:.0f} cm²/s",
                (w.x * 1e3, w.y * 1e3),
            )
        axis.plot(centre[0] * 1e3, centre[1] * 1e3, "k+", ms=12)
        axis.set(title=title, xlim=(-20, 40), ylim=(-30, 30), aspect="equal", xlabel="x, mm")
    axes[0].set_ylabel("y, mm")
    figure.savefig(path, dpi=80)


if __name__ == "__main__":
    main(sys.argv[1])
