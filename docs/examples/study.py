"""A study: two rows of a table become runs, and their results a table."""

import subprocess
import sys
from pathlib import Path

import pandas as pd

folder = Path("cases/single_finger/studies")
rows = "run,level,until,motion.end_time,fluid.kinematic_viscosity\n"
rows += "thin,smoke,solve,0.1,1e-6\nthick,smoke,solve,0.1,1e-4\n"
(folder / "viscosity.csv").write_text(rows)
subprocess.run([sys.executable, "-m", "softfinger", "study", folder / "viscosity.csv"], check=True)
table = pd.read_csv("cases/single_finger/out/studies/viscosity/table.csv")
axes = table.plot.bar(x="run", y="peak_force_N", rot=0, ylabel="largest force, N", legend=False)
axes.figure.savefig("study.png", dpi=120)
