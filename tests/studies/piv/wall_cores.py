"""How well a region tells the core radius of a vortex beside a wall: what `region_prior` of the vortex fit is set on.

python -m tests.studies.piv.wall_cores
Analytic vortices 0.1 to 1.2 core radii off a wall, with and without the layer that feeds them, on fine planes and on coarse
ones with noise and without the vectors next to the wall, as PIV gives them.
"""

from __future__ import annotations

import itertools

import numpy as np

from piv.vortices.criteria import gradients
from piv.vortices.find import plane_of
from piv.vortices.regions import REGION_RADIUS, Candidate, find_candidates
from piv.vortices.settings import VortexSettings
from tests.analytic.piv.tip_scene import young_scene

CORES = (2.4e-3, 3.5e-3, 5e-3)  # m
GAPS = (0.1, 0.3, 0.5, 0.8, 1.2)  # core radii
PLANES = (
    (0.5e-3, 0.0, 0.0, 1),
    (1e-3, 0.5e-3, 5e-3, 4),
    (1e-3, 1.2e-3, 0.01, 4),
)  # step, hidden, noise, seeds


def region_of(plane, core: float, gap: float) -> Candidate | None:
    """The candidate whose centre is within a core radius of the vortex."""
    p, settings = plane_of(plane, "equal"), VortexSettings(stencil_radius=3e-3)
    step = float(p.x[1] - p.x[0])
    candidates = find_candidates(
        p, gradients(p.u, p.v, p.valid, step, step, settings.scheme), settings
    )
    near = [c for c in candidates if c.circulation > 0 and np.hypot(c.x + gap * core, c.y) < core]
    return near[0] if near else None


def main() -> None:
    """Print the RMS of the relative deviation, with the region made whole and as the wall cuts it."""
    whole, cut = [], []
    for core, gap, layer, (step, hidden, noise, seeds) in itertools.product(
        CORES, GAPS, (0.0, 0.3), PLANES
    ):
        for seed in range(seeds):
            plane, _, _ = young_scene(
                step, core=core, gap=gap, layer_part=layer, hidden=hidden, noise=noise, seed=seed
            )
            region = region_of(plane, core, gap)
            if region is not None:
                whole.append(np.log(region.core_radius / core))
                cut.append(np.log(np.sqrt(region.points * step**2 / np.pi) / REGION_RADIUS / core))
    for name, deviation in (("made whole", whole), ("as the wall cuts it", cut)):
        print(
            f"{name}: RMS {np.sqrt(np.mean(np.square(deviation))):.2f} of {len(deviation)} vortices"
        )


if __name__ == "__main__":
    main()
