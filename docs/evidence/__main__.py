"""All tables and pictures of the docs that hold measured numbers, anew, in a night.

    make evidence    (or python -m docs.evidence [PART ...] [--list])

Two parts run at a time, each on one core. A part that has ended on this commit is not run again; of
changes that are not committed it is. One that was stopped goes on where its own records allow. The
output of a part is .evidence/<part>.log. docs/verification/parts.csv keeps when each has ended, on
which commit, and its CPU time, from which the estimates are.
"""

import argparse
import json
import os
import signal
import subprocess
import sys
import threading
import time
from dataclasses import dataclass
from pathlib import Path

import pandas as pd

from piv.files.atomic import write_text
from postprocess.tables import write_table
from softfinger.study.table import commit

TABLE = Path("docs/verification/parts.csv")
STATE = Path(".evidence")
_CORES = 2  # parts that run at a time
_PY, _RUN = (".venv/bin/python", "-m"), ".venv/bin/softfinger"
_ENVIRONMENT = {"MAKELEVEL": "1", "TYPED": "NP", "NP": "1"}  # as make NP=1
_ENVIRONMENT |= {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}

_OWN_PIV = ("limits", "vortex_errors", "costs")  # studies of PIV without other programs


def _study(name: str) -> tuple[str, ...]:
    scene, _, table = name.partition("/")
    return _RUN, "study", f"cases/{scene}/studies/{table}.csv"


@dataclass(frozen=True)
class Part:
    """A part of the evidence: its commands, in order, and the parts whose runs it reads."""

    commands: tuple[tuple[str, ...], ...]
    after: tuple[str, ...] = ()


PARTS = {
    "tradeoff": Part(((_RUN, "tradeoff", "cases/single_finger"),)),
    "sensitivity": Part(((*_PY, "docs.evidence.sensitivity"),), ("tradeoff",)),
    "validation": Part(
        tuple(_study(f"validation/{name}") for name in ("validation", "convergence", "turek_hron"))
    ),
    "checks": Part(((*_PY, "docs.evidence.validation"),), ("validation", "tradeoff")),
    "stability": Part(
        (_study("single_finger/stability"), _study("single_finger/stability_finer"),
         _study("pinch/stability"), _study("pinch/stability_finer"),
         (*_PY, "docs.evidence.stability", "--part", "runs")),
    ),
    "drawn": Part(
        (_study("single_finger/drawn"), (*_PY, "docs.evidence.stability", "--part", "drawn")),
    ),
    "images": Part(((*_PY, "docs.evidence.stability", "--part", "images"),)),
    "coupling": Part(
        (_study("single_finger/coupling"), _study("pinch/contact"),
         (*_PY, "docs.evidence.coupling")),
    ),
    "faults": Part(((*_PY, "docs.evidence.faults"),)),
    "piv": Part(tuple((*_PY, "docs.evidence.piv", name) for name in _OWN_PIV)),
    "fig-9": Part(((*_PY, "docs.evidence.air_and_water"),)),
    "park": Part(((*_PY, "docs.evidence.park"),)),
    "twin": Part(
        ((*_PY, "docs.evidence.twin", "1", "9", "--coupled"),
         (*_PY, "docs.evidence.twin", "11", "12", "--coupled"),
         (*_PY, "docs.evidence.twin", "207", "218")),
    ),
    "docs": Part((("make", "docs"),), ("tradeoff", "checks", "stability", "drawn", "coupling")),
}  # fmt: skip


class Night:
    """Runs parts, `cores` at a time, and prints what has ended and what is left."""

    def __init__(self, parts: dict[str, Part], at: str, cores: int = _CORES) -> None:
        self.parts, self.at, self.cores = parts, at, cores
        self.table = pd.read_csv(TABLE, index_col="part", dtype=str, keep_default_na=False)
        self.codes = {name: 0 for name in parts if self._ended(name)}  # of parts that have ended
        self.begun = dict[str, float]()  # time.time() of the parts that run
        self.stopped = False
        self._jobs = dict[str, subprocess.Popen[bytes]]()
        self._changed = threading.Condition()

    def _ended(self, name: str) -> bool:
        """Whether a part has ended well on this commit, if the code is that of a commit."""
        if not self.at or self.at.endswith("-dirty"):
            return False
        state = STATE / f"{name}.json"
        return state.exists() and json.loads(state.read_text()) == {"commit": self.at}

    def hours(self, name: str) -> float:
        """CPU hours of a part: measured by its last whole run; 0 where it is not known."""
        text = self.table["cpu_h"].get(name, "")
        return float(text) if text else 0.0

    def left(self) -> str:
        """Hours until all have ended, and the parts that they leave out."""
        more = [n for n in self.parts if n not in self.codes and not self.hours(n)]
        return f"about {self.hours_left():.1f} h" + (f" and {', '.join(more)}" if more else "")

    def hours_left(self) -> float:
        """Hours until all of known cost have ended: those of the longest, or all over the cores."""
        now = time.time()
        rest = {
            name: max(self.hours(name) - (now - self.begun.get(name, now)) / 3600, 0.0)
            for name in self.parts
            if name not in self.codes
        }
        return max([sum(rest.values()) / self.cores, *rest.values()], default=0.0)

    def _next(self) -> str | None:
        """The longest part that may begin, if any.

        What a part before it has not made, because it failed, its own command refuses.
        """
        open_parts = self.parts.keys() - self.codes
        free = [n for n in self.parts if n in open_parts and n not in self.begun]
        free = [n for n in free if open_parts.isdisjoint(self.parts[n].after)]
        return None if self.stopped else max(free, key=self.hours, default=None)

    def _say(self, text: str) -> None:
        clock = time.strftime("%H:%M")
        known = f"{len(self.codes)} of {len(self.parts)} ended, {self.left()} left"
        print(f"{clock} {text} ({known})", flush=True)

    def _run(self, name: str) -> int:
        """Run the commands of a part; its exit code."""
        cpu = 0.0
        environment = os.environ | _ENVIRONMENT
        with (STATE / f"{name}.log").open("a", encoding="utf-8") as log:
            for words in self.parts[name].commands:
                job = subprocess.Popen(words, stdout=log, stderr=log, env=environment)
                self._jobs[name] = job
                _, status, used = os.wait4(job.pid, 0)
                job.returncode = os.waitstatus_to_exitcode(status)
                cpu += used.ru_utime + used.ru_stime
                if job.returncode or self.stopped:
                    return job.returncode or signal.SIGTERM
        self._record(name, cpu / 3600)
        return 0

    def _record(self, name: str, hours: float) -> None:
        """Write when a part has ended. Of a part that found runs made, the last cost stays."""
        with self._changed:
            hours = max(hours, self.hours(name))
            made = {
                "cpu_h": f"{hours:.2f}",
                "from": "whole",
                "made": time.strftime("%Y-%m-%d"),
                "commit": self.at,
            }
            self.table.loc[name, list(made)] = list(made.values())
            write_table(TABLE, self.table.reset_index())
            write_text(STATE / f"{name}.json", json.dumps({"commit": self.at}))

    def _work(self) -> None:
        """Take parts until none is left."""
        while True:
            with self._changed:
                while (name := self._next()) is None:
                    if not self.begun:
                        return
                    self._changed.wait()
                self.begun[name] = time.time()
                self._say(f"{name} begins: {STATE / name}.log")
            code = self._run(name)
            with self._changed:
                self.codes[name] = code
                del self.begun[name]
                self._say(f"{name} has ended" if not code else f"{name} FAILED, code {code}")
                self._changed.notify_all()

    def run(self) -> list[str]:
        """Run all that has not ended; the names of what failed."""
        STATE.mkdir(exist_ok=True)
        workers = [threading.Thread(target=self._work) for _ in range(self.cores)]
        for worker in workers:
            worker.start()
        try:
            for worker in workers:
                worker.join()
        except KeyboardInterrupt:
            self.stopped = True
            for name in self.begun:
                self._jobs[name].terminate()
            raise
        return [name for name, code in self.codes.items() if code]


def main() -> int:
    """Command line; 1 where a part failed."""
    parser = argparse.ArgumentParser(prog="python -m docs.evidence", description=__doc__)
    parser.add_argument("parts", nargs="*", metavar="PART", help=f"of {', '.join(PARTS)}")
    parser.add_argument("--list", action="store_true", help="only what is known of the parts")
    args = parser.parse_args()
    if unknown := [name for name in args.parts if name not in PARTS]:
        parser.error(f"{unknown[0]}: no such part")
    night = Night({n: p for n, p in PARTS.items() if n in (args.parts or PARTS)}, commit())
    if args.list:
        print(night.table.to_string())
        print(f"{night.left()} for what has not ended on commit {night.at}")
        return 0
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    failed = night.run()
    for name in failed:
        print(f"{name} failed: see {STATE / name}.log, then make evidence again")
    return int(bool(failed))


if __name__ == "__main__":
    sys.exit(main())
