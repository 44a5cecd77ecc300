"""How a stage's exit and its last words become an outcome; a stage that hangs is ended."""

from __future__ import annotations

import sys
import time

import pytest

from pipeline.study.outcome import outcome_of, run_stage

TRACE = "Traceback (most recent call last):\n  File x\nKeyError: 'a'\n"


@pytest.mark.parametrize(
    "code, said, ended, reason",
    [
        (2, "mesh: cases/a/scene.toml: mesh.tip_cell: too coarse\n", "refused", "too coarse"),
        (
            2,
            "run: stopped at 0.0125 s by a guard: Courant number 31\n",
            "stopped",
            "Courant number 31",
        ),
        (2, "run: pimpleFoam failed at 0.1 s (log: x); its last lines:\nwhat\n", "failed", "what"),
        (1, TRACE, "crashed", "KeyError: 'a'"),
        (2, TRACE, "crashed", "KeyError: 'a'"),
        (-11, "", "crashed", "exit code -11"),
    ],
)
def test_outcomes(code, said, ended, reason):
    result = outcome_of(code, said)
    assert result["ended"] == ended
    assert reason in result["reason"]
    assert result.get("stopped_at_s") == (0.0125 if ended == "stopped" else None)


def test_a_stage_that_hangs_is_ended():
    begin = time.monotonic()
    assert run_stage([sys.executable, "-c", "import time; time.sleep(60)"], longest=0.5) is None
    assert time.monotonic() - begin < 10


def test_exit_code_and_words_are_passed_on():
    done = run_stage([sys.executable, "-c", "import sys; sys.stderr.write('no'); sys.exit(2)"])
    assert done == (2, "no")
