"""`make bench-piv`: every study of PIV in a process of its own; writes docs/piv_benchmarks.

python -m tests.studies.piv limits    one of them. Pairs and peers' results stay in .venv-bench, so
that a stopped run goes on. All work on one core: CPU times can be compared.
"""

import os
import subprocess
import sys
from importlib import import_module

STUDIES = ("limits", "benchmark", "turbulence", "public_data", "vortex_errors", "costs")

if __name__ == "__main__":
    os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    os.environ |= dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1")
    if len(sys.argv) > 1:
        import_module(f"tests.studies.piv.{sys.argv[1]}").study()
    for name in STUDIES if len(sys.argv) == 1 else ():
        subprocess.run([sys.executable, "-m", "tests.studies.piv", name], check=True)
