"""The environment of a make that a test runs: nothing in it of the make that runs the tests."""

import os

# an outer make's jobs and command line, and the values that it exports
OUTER = {
    "MAKEFLAGS", "MFLAGS", "MAKELEVEL", "MAKEOVERRIDES", "TYPED", "SCENE", "STUDY", "DOCS", "LEVEL",
    "NP", "COUPLED", "ACCURACY", "BUDGET", "SLURM", "DPIV",
}  # fmt: skip


def inner_environment(**added: str) -> dict[str, str]:
    """This process's environment without what an outer make put there, and with `added`."""
    return {name: value for name, value in os.environ.items() if name not in OUTER} | added
