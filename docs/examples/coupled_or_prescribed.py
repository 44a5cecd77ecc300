"""The bend of a finger that water holds back, and of the same finger as prescribed."""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from pipeline.formats.kinematics import read_kinematics
from softfinger.make import Machine, make
from softfinger.options import open_moved

for label, coupled in (("prescribed", False), ("coupled", True)):
    run = open_moved(Path("cases/single_finger"), "smoke", coupled)
    make(run, "solve", Machine(2, 2), quiet=True)
    own = run.out / "run" / "kinematics.h5"
    motion = read_kinematics(own if own.exists() else run.path("kinematics"))
    time = np.linspace(*motion.time, 200)
    plt.plot(time, np.degrees(motion.shape("bend", motion.law(time))), label=label)
plt.xlabel("time, s")
plt.ylabel("bend, deg")
plt.legend()
plt.savefig("coupled_or_prescribed.png", dpi=120)
