"""A study over seeds: goes on where its table ends, and writes its summary into a page."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import pandas as pd
from scipy.stats import binomtest

from fileio.formats.kinematics import Kinematics
from tests.lab_scene import finger_kinematics
from tests.studies.pages import write_between


def study(name: str, about: str | None, seeds: int, trial: Callable[[Kinematics, int], dict[str, Any]],
          summary: Callable[[pd.DataFrame], str]) -> None:  # fmt: skip
    """Run `trial` for the seeds that are not in the table yet; `name`: of the module and of the marks in the page."""
    parser = argparse.ArgumentParser(
        prog=f"python -m tests.studies.laboratory.{name}", description=about
    )
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
        publish(args.docs, name, summary(done), done)


def publish(page: Path, mark: str, text: str, trials: pd.DataFrame) -> None:
    """Write a summary into a page, and beside it the table that it is of, in a folder of the page's name."""
    table = page.with_suffix("") / f"{mark.replace(' ', '_')}.csv"
    table.parent.mkdir(exist_ok=True)
    trials.to_csv(table, index=False, float_format="%.6g")
    write_between(
        page, mark, f"{text}\nEvery recording: [{table.name}]({table.parent.name}/{table.name})."
    )


def spans(seeds: pd.Series) -> str:
    """Seeds in words: 1, 2, 3, 7 as "1–3, 7"."""
    numbers = sorted(int(seed) for seed in seeds)
    first = [n for n in numbers if n - 1 not in numbers]
    last = [n for n in numbers if n + 1 not in numbers]
    return ", ".join(f"{a}" if a == b else f"{a}–{b}" for a, b in zip(first, last, strict=True))


def share_of(right: pd.Series) -> str:
    """How many of some trials, with the 95 % interval of the share (Clopper and Pearson)."""
    count, total = int(right.sum()), len(right)
    if total == 0:
        return "0 of 0"
    low, high = binomtest(count, total).proportion_ci(0.95)
    return f"{count} of {total}, {count / total:.0%} ({100 * low:.0f}–{100 * high:.0f} %)"


def below_target(held: dict[str, pd.Series], target: float = 0.9) -> str:
    """The quantities whose band covers the truth less often than the target, each by itself: a mean over all would hide them."""
    missed = [
        f"{label} {share_of(inside)}" for label, inside in held.items() if inside.mean() < target
    ]
    return f"Coverage below {target:.0%} (95 % interval): {'; '.join(missed) or 'none'}."
