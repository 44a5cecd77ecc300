"""All tables and pictures of the docs that hold measured numbers, anew, in a night.

    make evidence    (or python -m docs.evidence [PART ...] [--list])

Two parts run at a time, each on one core. docs/verification/parts.csv keeps when each has ended, on
which commit, and its CPU time, from which the estimates are. A part that has ended with this code
is not run again, unless its name is given; of code that is not committed it is. Parts that take too
long for a night run by their names alone. One that was stopped goes on where its own records allow.
The output of a part is .evidence/<part>.log.
"""

import argparse
import os
import signal
import subprocess
import sys
import time
from collections.abc import Collection
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from contextlib import suppress
from dataclasses import dataclass
from graphlib import TopologicalSorter
from pathlib import Path

import pandas as pd

from piv.files.command import guarded
from postprocess.tables import write_table
from softfinger.study.table import commit

TABLE = Path("docs/verification/parts.csv")
STATE = Path(".evidence")
CORES = 2  # parts that run at a time
_PY, _RUN = (".venv/bin/python", "-m"), ".venv/bin/softfinger"
_RUNNING = set[subprocess.Popen[bytes]]()
_ENVIRONMENT = {"MAKELEVEL": "1", "TYPED": "NP", "NP": "1"}  # as make NP=1
_ENVIRONMENT |= {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}

_OWN_PIV = ("limits", "vortex_errors", "costs")  # studies of PIV without other programs


def _study(name: str) -> tuple[str, ...]:
    scene, _, table = name.partition("/")
    return _RUN, "study", f"cases/{scene}/studies/{table}.csv"


@dataclass(frozen=True)
class Part:
    """A part of the evidence: its commands, in order, and the parts whose runs it reads.

    `long`: it takes hours, and is run by its name alone.
    """

    commands: tuple[tuple[str, ...], ...]
    after: tuple[str, ...] = ()
    long: bool = False


PARTS = {
    "tradeoff": Part(((_RUN, "tradeoff", "cases/single_finger"),)),
    "validation": Part(
        tuple(
            _study(f"validation/{name}")
            for name in ("validation", "convergence", "turek_hron")
        )
    ),
    "checks": Part(
        ((*_PY, "docs.evidence.validation"), (*_PY, "docs.evidence.pictures")),
        ("validation", "tradeoff"),
    ),
    "stability": Part(
        (_study("single_finger/stability"), _study("pinch/stability"),
         (*_PY, "docs.evidence.stability", "--part", "runs")),
    ),
    "drawn": Part(
        (_study("single_finger/drawn"), (*_PY, "docs.evidence.stability", "--part", "drawn")),
    ),
    "images": Part(((*_PY, "docs.evidence.stability", "--part", "images"),)),
    "coupling": Part(
        (_study("pinch/contact"), (*_PY, "docs.evidence.coupling")),
    ),
    "faults": Part(((*_PY, "docs.evidence.faults"),)),
    "piv": Part(tuple((*_PY, "docs.evidence.piv", name) for name in _OWN_PIV)),
    "fig-9": Part(((*_PY, "docs.evidence.air_and_water"),)),
    "park": Part(((*_PY, "docs.evidence.park"),), long=True),
    "flutter": Part(
        (_study("validation/turek_hron_flutter"),
         (*_PY, "docs.evidence.validation", "turek_hron_flutter")),
        long=True,
    ),
    "blade": Part(
        (_study("validation/luhar_nepf"), (*_PY, "docs.evidence.validation", "luhar_nepf")),
        long=True,
    ),
    "twin": Part(
        ((*_PY, "docs.evidence.twin", "1", "9", "--coupled"),
         (*_PY, "docs.evidence.twin", "11", "23", "--coupled"),
         (*_PY, "docs.evidence.twin", "207", "218")),
        long=True,
    ),
    "docs": Part((("make", "docs"),)),
}  # fmt: skip


@dataclass(frozen=True)
class Night:
    """Parts that are run, two at a time, on the commit `at`; `again`: also what ended on it."""

    parts: dict[str, Part]
    at: str
    again: bool = False

    def due(self) -> dict[str, Part]:
        """What has not ended well on this commit, or all of unknown code; and what it reads."""
        known = self.at and not self.at.endswith("-dirty") and not self.again
        made = _table()["commit"] if known else {}
        due = {name for name in self.parts if not known or made.get(name) != self.at}
        while more := {n for one in due for n in self.parts[one].after if n in self.parts} - due:
            due |= more
        return {name: part for name, part in self.parts.items() if name in due}

    @staticmethod
    def left(names: Collection[str]) -> str:
        """Hours until all have ended: those of the longest, or all over the cores."""
        known = [hours for name in names if (hours := _hours(name))]
        more = [name for name in names if not _hours(name)]
        hours = max([sum(known) / CORES, *known], default=0.0)
        return f"about {hours:.1f} h" + (f" and {', '.join(more)}" if more else "")

    def run(self) -> list[str]:
        """Run all that has not ended; the names of what failed.

        What a part before it has not made, because it failed, its own command refuses.
        """
        STATE.mkdir(exist_ok=True)
        due = self.due()
        order = TopologicalSorter({name: due.keys() & part.after for name, part in due.items()})
        order.prepare()
        failed, jobs, left = list[str](), dict[Future[float | None], str](), set(due)
        with ThreadPoolExecutor(CORES) as pool:
            try:
                while order.is_active():
                    for name in sorted(order.get_ready(), key=_hours, reverse=True):
                        jobs[pool.submit(_run, name, due[name])] = name
                    for job in wait(jobs, return_when=FIRST_COMPLETED).done:
                        order.done(name := jobs.pop(job))
                        left.discard(name)
                        if (hours := job.result()) is None:
                            failed.append(name)
                        else:
                            _record(name, hours, self.at)
                        how = "FAILED" if hours is None else "has ended"
                        clock = time.strftime("%H:%M")
                        print(f"{clock} {name} {how}, {self.left(left)} left", flush=True)
            except KeyboardInterrupt:  # also of SIGTERM: no part begins any more, and those end
                pool.shutdown(wait=False, cancel_futures=True)
                for process in list(_RUNNING):  # with all that it has started
                    with suppress(ProcessLookupError):  # it has just ended
                        os.killpg(process.pid, signal.SIGTERM)
                raise
        return failed


def _hours(name: str) -> float:
    """CPU hours of a part by its last whole run, or as estimated; 0 where it is not known."""
    text = _table()["cpu_h"].get(name, "")
    return float(text) if text else 0.0


def _table() -> pd.DataFrame:
    return pd.read_csv(TABLE, index_col="part", dtype=str, keep_default_na=False)


def _run(name: str, part: Part) -> float | None:
    """Run the commands of a part; its CPU hours, None where one fails."""
    cpu = 0.0
    with (STATE / f"{name}.log").open("a", encoding="utf-8") as log:
        for words in part.commands:
            job = subprocess.Popen(
                words, stdout=log, stderr=log, env=os.environ | _ENVIRONMENT, start_new_session=True
            )
            _RUNNING.add(job)
            _, status, used = os.wait4(job.pid, 0)
            job.returncode = os.waitstatus_to_exitcode(status)
            _RUNNING.discard(job)
            cpu += used.ru_utime + used.ru_stime
            if job.returncode:
                return None
    return cpu / 3600


def _record(name: str, hours: float, at: str) -> None:
    """Write when a part has ended. Of one that found runs made, the cost of the whole stays."""
    made = time.strftime("%Y-%m-%d")
    table = _table()
    before = _hours(name) if table["from"].get(name) == "whole" else 0.0
    cost = f"{max(hours, before):.2f}"
    table.loc[name, ["cpu_h", "from", "made", "commit"]] = [cost, "whole", made, at]
    write_table(TABLE, table.reset_index())


def main() -> int:
    """Command line; 1 where a part failed."""
    parser = argparse.ArgumentParser(prog="python -m docs.evidence", description=__doc__)
    parser.add_argument("parts", nargs="*", metavar="PART", help=f"of {', '.join(PARTS)}")
    parser.add_argument("--list", action="store_true", help="only what is known of the parts")
    args = parser.parse_args()
    if unknown := [name for name in args.parts if name not in PARTS]:
        parser.error(f"{unknown[0]}: no such part")
    wanted = args.parts or [name for name, part in PARTS.items() if not part.long]
    night = Night({name: PARTS[name] for name in wanted}, commit(), bool(args.parts))
    if args.list:
        print(f"{_table().to_string()}\n{night.left(night.due())} for what is due on {night.at}")
        return 0
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    failed = night.run()
    for name in failed:
        print(f"{name} failed: see {STATE / name}.log, then python -m docs.evidence {name}")
    return int(bool(failed))


if __name__ == "__main__":
    sys.exit(guarded("evidence", main, strict=True))
