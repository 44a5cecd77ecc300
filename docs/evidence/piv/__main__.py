"""`make bench-piv`: every study of PIV in a process of its own; writes docs/piv_benchmarks.

`python -m docs.evidence.piv limits` runs one of them. Pairs and peers' results stay in .venv-bench,
so that a stopped run goes on. All work on one core: CPU times can be compared.
"""

import argparse
import os
import subprocess
import sys
from importlib import import_module

STUDIES = (
    "limits",
    "benchmark",
    "turbulence",
    "public_data",
    "vortex_errors",
    "exact_truth",
    "costs",
    "long_recording",
)

if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="python -m docs.evidence.piv", description=__doc__)
    parser.add_argument("study", nargs="?", choices=STUDIES, help="all if absent")
    study = parser.parse_args().study
    os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    os.environ |= dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1")
    if study:
        import_module(f"docs.evidence.piv.{study}").study()
    for name in () if study else STUDIES:
        subprocess.run([sys.executable, "-m", "docs.evidence.piv", name], check=True)
