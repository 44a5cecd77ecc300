"""The environment of a make that a test runs, without that of an outer make."""

from __future__ import annotations

import os

# Variables by which an outer make passes its jobs and command line to an inner one.
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
