"""`make bench-piv`: every study of PIV in a process of its own; writes docs/piv_benchmarks.

Pairs and peers' results lie in .venv-bench, so that a stopped run goes on.
"""

import subprocess
import sys

KEPT = {"benchmark": "benchmark", "turbulence": "turbulence", "public_data": "public"}

if __name__ == "__main__":
    for name in ("limits", "unseen", *KEPT, "costs"):
        keep = ["--folder", f".venv-bench/{KEPT[name]}"] if name in KEPT else []
        words = [sys.executable, "-m", f"tests.studies.piv.{name}", "--docs", *keep]
        if code := subprocess.run(words, check=False).returncode:
            sys.exit(code)
