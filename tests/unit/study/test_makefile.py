"""The Makefile says what it can do, and the docs are made at the levels that they say they were made at."""

import re
import subprocess

import pytest

from fileio.command import DEFAULT_LEVEL
from pipeline.openfoam.base_case import template_files
from pipeline.scene.scene import load_scene
from tests.conftest import ROOT
from tests.inner_make import inner_environment

MAKEFILES = [
    ROOT / "Makefile",
    ROOT / "postprocess" / "lab" / "compare.mk",
    ROOT / "fileio" / "stages.mk",
]
TEXT = "\n".join(path.read_text(encoding="utf-8") for path in MAKEFILES)
LISTED = [page.split(":")[:2] for page in re.search(r"(?m)^DOCS \?= (.*)$", TEXT).group(1).split()]
# a page is named by its scene, at the default level, or by scene and level
DOCUMENTED = {
    scene if level == DEFAULT_LEVEL else f"{scene}_{level}": (scene, level)
    for scene, level in LISTED
}


@pytest.fixture(scope="module")
def told():
    """What `make help` prints."""
    done = subprocess.run(
        ["make", "-s", "help"], cwd=ROOT, capture_output=True, text=True, check=True
    )
    return done.stdout


def phony():
    """Targets for a user that are no scene's."""
    return set(
        re.search(r"(?m)^USER_TARGETS := ((?:.*\\\n)*.*)$", TEXT)
        .group(1)
        .replace("\\\n", " ")
        .split()
    )


def test_every_target_for_a_user_has_a_line_of_help(told):
    listed = set(re.findall(r"(?m)^make ([a-z-]+) ", told))
    assert phony() <= listed
    assert (
        set(re.findall(r"(?m)^([a-z][a-z-]+):(?!=).*##", TEXT)) == phony()
    )  # and the other way round


def test_what_the_readme_and_the_docs_tell_to_make_is_there(told):
    scenes = {path.parent.name for path in (ROOT / "cases").glob("*/scene.toml")} | {"SCENE"}
    scenes.add("slurm_test")  # of tests/slurm, in its log
    pages = [
        ROOT / "README.md",
        *(ROOT / "docs").glob("*.md"),
        *(ROOT / "docs" / "fea").glob("*.md"),
    ]
    for page in pages:
        asked = set(re.findall(r"`make ([a-z][a-z_.-]*)", page.read_text(encoding="utf-8")))
        assert {name.split(".")[0] for name in asked} <= phony() | scenes, page


def test_the_makefiles_can_be_read():
    assert max(len(line) for line in TEXT.splitlines()) <= 120


@pytest.mark.parametrize("page", sorted(DOCUMENTED))
def test_the_docs_are_made_at_the_level_that_their_page_says(page):
    scene, level = DOCUMENTED[page]
    assert f"`cases/{scene}/out/{level}/`" in (ROOT / "docs" / f"{page}.md").read_text(
        encoding="utf-8"
    )
    assert load_scene(ROOT / "cases" / scene, level).level == level


def test_settings_are_looked_at_again_when_a_template_of_the_case_changes():
    """And when one is added or goes, which dates its folder."""
    stamp = "cases/single_finger/out/coarse/settings/.stamp"
    asked = ["make", "-npr", "READY=Makefile", "LEVEL=coarse", "single_finger.kinematics"]
    rules = subprocess.run(
        asked, cwd=ROOT, capture_output=True, text=True, check=False, env=inner_environment()
    ).stdout
    named = set(re.search(rf"(?m)^{re.escape(stamp)}: ([^|\n]*)", rules).group(1).split())
    base = ROOT / "cases" / "_base"
    assert named >= {
        str(path.relative_to(ROOT))
        for path in (base, *(p.parent for p in template_files()), *template_files())
    }


def test_every_page_that_comes_from_a_run_is_made_by_make_docs():
    made = {
        p.stem
        for p in (ROOT / "docs").glob("*.md")
        if "Written by `make docs`" in p.read_text(encoding="utf-8")
    }
    assert made == set(DOCUMENTED)
