"""A copy of the project in which scenes are made."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

from tests.conftest import ROOT
from tests.inner_make import inner_environment

PARTS = (
    "Makefile",
    "requirements.lock",
    "pyproject.toml",
    "cases",
    "fileio",
    "pipeline",
    "piv",
    "postprocess",
)


@pytest.fixture(scope="module")
def project(tmp_path_factory):
    """A copy of the project without results, with this environment linked in; what numba has compiled comes along."""
    folder = tmp_path_factory.mktemp("project")
    for part in PARTS:
        source = ROOT / part
        if source.is_dir():
            shutil.copytree(source, folder / part, ignore=shutil.ignore_patterns("out"))
        else:
            shutil.copy2(source, folder / part)
    (folder / ".venv").symlink_to(ROOT / ".venv")
    return folder


def make(project: Path, *arguments: str) -> subprocess.CompletedProcess:
    """The make that a user would type, at level smoke."""
    command = [
        "make",
        "--no-print-directory",
        "LEVEL=smoke",
        "QUIET=1",
        "READY=Makefile",
        *arguments,
    ]
    return subprocess.run(
        command, cwd=project, capture_output=True, text=True, check=False, env=inner_environment()
    )
