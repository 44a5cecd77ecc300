"""A study over seeds: goes on where its table ends, and writes its summary into a page."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import pandas as pd

from fileio.formats.kinematics import Kinematics
from tests.lab_scene import finger_kinematics
from tests.studies.pages import write_between


def study(name: str, about: str | None, seeds: int, trial: Callable[[Kinematics, int], dict[str, Any]],
          summary: Callable[[pd.DataFrame], str]) -> None:  # fmt: skip
    """Run `trial` for the seeds that are not in the table yet; `name`: of the module and of the marks in the page."""
    parser = argparse.ArgumentParser(prog=f"python -m tests.studies.laboratory.{name}", description=about)
    parser.add_argument("--seeds", type=int, default=seeds)
    parser.add_argument("--first", type=int, default=1, help="the first seed")
    parser.add_argument("-o", "--output", type=Path, required=True)
    parser.add_argument("--docs", type=Path, help="page to write the tables to")
    args = parser.parse_args()
    done = pd.read_csv(args.output) if args.output.exists() else pd.DataFrame({"seed": []})
    with TemporaryDirectory() as folder:
        kinematics = finger_kinematics(Path(folder))
    for seed in range(args.first, args.first + args.seeds):
        if not (done["seed"] == seed).any():
            done = pd.concat([done, pd.DataFrame([trial(kinematics, seed)])], ignore_index=True)
            done.to_csv(args.output, index=False)
            print(done.iloc[-1].to_dict(), flush=True)
    print(summary(done))
    if args.docs:
        write_between(args.docs, name, summary(done))
