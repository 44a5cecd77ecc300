"""Whether the law of motion explains single pictures: factors, misfit, jumps of the clock."""

from __future__ import annotations

import numpy as np

from fileio.formats.kinematics import Kinematics
from postprocess.lab.data.files import Registration
from postprocess.lab.registration.register import law_pressure

LARGEST = 2.0  # factor by which pressure and duration may differ, either way
_MISFIT = 0.04  # of the range of pressure: rms distance of single pictures from the law
SURE = 6.0  # standard deviations of a jump: every instant is tried
ENDS = 4  # pictures before and behind a jump, at least
FEWEST = 2 * ENDS + 4  # pictures, for a jump to be looked for: six things are fitted
NOISE = 0.002  # of the range of pressure: what a single picture is not known better than


def check_motion(kinematics: Kinematics, registration: Registration, interval: float) -> list[str]:
    """Sentences on what the law does not explain; `interval` (s): between successive pictures."""
    factor, _, stretch = registration.law.values
    span = kinematics.high - kinematics.low
    if not 1 / LARGEST < stretch < LARGEST:
        return [
            f"the stroke of the pictures takes {stretch:.2g} times the simulation's; correct"
            " frame_rate_hz (of pictures in pairs: the pairs per second), or motion.strokes of the"
            " scene"
        ]
    if not 1 / LARGEST < factor < LARGEST:
        return [
            f"the finger of the pictures bends as at {factor:.2g} times the simulation's pressure;"
            " correct motion.strokes of the scene"
        ]
    at, jump, std = _largest_jump(kinematics, registration)
    if abs(jump) > max(SURE * std, 0.7 * interval):
        where, why = "ahead of", "pictures are missing there"
        if jump > 0:
            where, why = "behind", "a picture is there twice, or the finger halted"
        return [
            f"from {at:.3f} s of the recording on the finger is {abs(jump) * 1e3:.0f} ms {where}"
            f" its motion before: {why} (dropped frames); give the part before or behind it as a"
            " recording of its own"
        ]
    if registration.law.misfit > _MISFIT * span:
        off = abs(kinematics.splines["bend"](kinematics.high, 1)) * registration.law.misfit
        return [
            f"single pictures lie {np.degrees(off):.1f}° (rms) off the simulation's law of motion,"
            " however it is stretched; check frame_rate_hz, missing pictures, and motion.strokes of"
            " the scene"
        ]
    return []


def _largest_jump(kinematics: Kinematics, registration: Registration) -> tuple[float, float, float]:
    """The most significant jump of the clock: when (s), its size and standard deviation (s).

    Least squares of the pictures' pressures by the law, a smooth lag, and a delay from one picture
    on. Negative: the motion is ahead of the clock.
    """
    times, values = registration.times, registration.law.values
    if times.size < FEWEST:
        return 0.0, 0.0, np.inf
    span = kinematics.high - kinematics.low
    noise = np.hypot(registration.pressures_std, NOISE * span)
    rest = (registration.pressures - law_pressure(kinematics, times, values)) / noise
    steps = np.array([1e-3, 2e-4, 1e-3])
    basis = np.empty((times.size, 6))
    for k, step in enumerate(steps):
        change = step * np.eye(3)[k]
        ahead, back = (law_pressure(kinematics, times, values + s * change) for s in (1, -1))
        basis[:, k] = (ahead - back) / (2 * step) / noise
    # a finger that lags smoothly, as one with hysteresis, has no jump
    for k, power in ((3, 2), (4, 3)):
        basis[:, k] = basis[:, 1] * np.linspace(-1, 1, times.size) ** power
    best = (0.0, 0.0, np.inf)
    for split in range(ENDS, times.size - ENDS):
        basis[:, 5] = np.where(np.arange(times.size) >= split, basis[:, 1], 0.0)
        fit = np.linalg.lstsq(basis, rest, rcond=None)[0]
        left = rest - basis @ fit
        scatter = max(float(np.sum(left**2)) / (times.size - 6), 0.3)
        inverse = np.linalg.pinv(basis.T @ basis)
        std = float(np.sqrt(scatter * inverse[5, 5]))
        if std > 0 and abs(fit[5]) / std > abs(best[1]) / best[2]:
            best = (float(times[split]), float(fit[5]), std)
    return best
