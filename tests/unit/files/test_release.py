"""One version everywhere; commits and CI check the same; pages name what is there."""

import re

import pytest

from piv import __version__
from tests.conftest import ROOT


def text(name):
    return (ROOT / name).read_text(encoding="utf-8")


def test_the_citation_and_the_changelog_are_of_this_version():
    assert re.search(r"(?m)^version: (\S+)$", text("CITATION.cff")).group(1) == __version__
    assert re.search(r"(?m)^## (\S+)", text("CHANGELOG.md")).group(1) == __version__


def test_before_a_commit_runs_what_make_lint_runs():
    recipe = text("Makefile").partition("\nlint: ")[2].partition("\n\n")[0].splitlines()[1:]
    steps = [line.strip().replace("$(PY)", ".venv/bin/python") for line in recipe]
    assert re.findall(r"entry: (.*?), language", text(".pre-commit-config.yaml")) == steps


@pytest.mark.parametrize("page", ["CONTRIBUTING.md", "CHANGELOG.md"])
def test_what_a_page_names_is_there(page):
    links = re.findall(r"\]\((?!https?:)([^)#]+)", text(page))
    paths = re.findall(
        r"`((?:piv|pipeline|postprocess|softfinger|docs|cases)/[^`<> *]*)`", text(page)
    )
    assert [name for name in (*links, *paths) if not (ROOT / name).exists()] == []
