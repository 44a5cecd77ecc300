"""The environment of a make that a test runs: nothing in it of the make that runs the tests."""

from __future__ import annotations

import os

# An outer make's jobs, of which the inner one would complain, and its command line, which it would take for its own.
OUTER = (
    "MAKEFLAGS",
    "MFLAGS",
    "MAKELEVEL",
    "MAKEOVERRIDES",
    "NP",
    "LEVEL",
    "ACCURACY",
    "BUDGET",
    "CASES",
    "SCENE",
    "QUIET",
    "FLAGS",
    "SLURM",
    "HOSTS",
    "COLLATED",
)


def inner_environment(**added: str) -> dict[str, str]:
    """This process's environment without what an outer make put there, and with `added`."""
    return {name: value for name, value in os.environ.items() if name not in OUTER} | added
