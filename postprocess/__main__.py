"""What is made of a study's runs, and of a run for the docs."""

from __future__ import annotations

import sys

from fileio.command import Commands, command_line

COMMANDS: Commands = {
    "table": ("a study's runs as one table", "postprocess.studies.table"),
    "judge": ("a study's runs by their scene's findings", "postprocess.studies.judge"),
    "dpiv-reference": (
        "write docs/dpiv_reference.md: every key of dpiv.toml",
        "postprocess.lab.data.dpiv_reference",
    ),
    "tradeoff": ("what accuracy costs", "postprocess.studies.tradeoff"),
    "docs-page": ("a run's page in docs/", "postprocess.report.docs_page"),
}


def main(argv: list[str] | None = None) -> int:
    """Command line; returns the exit code."""
    return command_line("python -m postprocess", __doc__, COMMANDS, argv)


if __name__ == "__main__":
    sys.exit(main())
