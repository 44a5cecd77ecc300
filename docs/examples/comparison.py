"""What a run's comparison found: the circulation of simulation and PIV over time."""

import json
from pathlib import Path

import matplotlib.pyplot as plt
import pandas as pd

out = Path("cases/single_finger/out/smoke")
verdict = json.loads((out / "comparison.json").read_text())["verdict"]
table = pd.read_csv(out / "comparison.csv", comment="#")
print(table.columns.tolist(), verdict["agrees"])
for source in ("cfd", "piv"):
    plt.plot(table["time"], 1e4 * table[f"circulation_{source}"], label=source.upper())
plt.xlabel("time, s")
plt.ylabel("circulation of the tip vortex, cm²/s")
plt.legend()
plt.savefig("comparison.png", dpi=120)
