"""Tables and figures of a study's runs, and the reference of dpiv.toml."""

from __future__ import annotations

import sys

from fileio.command import Commands, command_line

_COMMANDS: Commands = {
    "table": ("a study's runs as one table", "postprocess.studies.table"),
    "dpiv-reference": (
        "write docs/dpiv_reference.md: every key of dpiv.toml",
        "postprocess.lab.data.dpiv_reference",
    ),
    "tradeoff": ("what accuracy costs: table and figure", "postprocess.studies.tradeoff"),
}


def main(argv: list[str] | None = None) -> int:
    """Command line; returns the exit code."""
    return command_line("python -m postprocess", __doc__, _COMMANDS, argv)


if __name__ == "__main__":
    sys.exit(main())
