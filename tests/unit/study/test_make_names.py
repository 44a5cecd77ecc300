"""What make takes into its rules and gives to a shell: names and numbers, nothing that these would execute."""

import os
import re
import shutil
import subprocess
import time

import pytest

from fileio.stages import STAGES
from tests.conftest import ROOT
from tests.inner_make import inner_environment

SPARED = ("cases", ".venv", ".git", "Makefile")
REFUSED = [
    "help",
    "a b",
    "c$(touch pwned)",
    "u$(x",
    "x:y",
    "x;y",
    "x#y",
    "q'q",
    '"',
    "-n",
    "%",
    "a\\",
]


def checkout(folder):
    """A checkout with one scene."""
    (folder / "cases" / "good").mkdir(parents=True)
    (folder / "cases" / "good" / "scene.toml").touch()
    shutil.copy(ROOT / "Makefile", folder)
    for path in ROOT.iterdir():
        if path.name not in SPARED:
            (folder / path.name).symlink_to(path)
    return folder


def make(folder, *words):
    return subprocess.run(
        ["make", "--no-print-directory", "-n", *words],
        cwd=folder, env=inner_environment(), capture_output=True, text=True, timeout=60,
    )  # fmt: skip


@pytest.fixture(scope="module")
def project(tmp_path_factory):
    return checkout(tmp_path_factory.mktemp("names") / "project")


@pytest.mark.parametrize("name", REFUSED)
def test_a_scene_of_another_name_is_left_out_with_a_sentence(project, name):
    folder = project / "cases" / name
    folder.mkdir()
    (folder / "scene.toml").touch()
    (project / "cases" / "good" / "reference").mkdir(exist_ok=True)
    (project / "cases" / "good" / "reference" / "r$(touch pwned).csv").touch()
    done = make(project, "good.kinematics")
    assert done.returncode == 0, done.stderr
    assert "pipeline kinematics cases/good" in done.stdout
    assert done.stderr.startswith(
        f"cases/{name} is left out: a scene is named by letters, digits, _ and -"
    )
    assert "the whole test suite" in subprocess.run(
        ["make", "help"], cwd=project, env=inner_environment(), capture_output=True, text=True
    ).stdout  # fmt: skip
    assert not (project / "pwned").exists()
    shutil.rmtree(folder)


@pytest.mark.parametrize(
    "word, sentence",
    [
        ("NP=-1", "NP=-1: give a whole number of 1 to 999999"),
        ("NP=abc", "NP=abc: give a whole number of 1 to 999999"),
        ("NP=0", "NP=0: give a whole number of 1 to 999999"),
        ("NP=000", "NP=000: give a whole number of 1 to 999999"),
        ("NP=99999999999999999999", "NP=99999999999999999999: give a whole number of 1 to 999999"),
        ("COUPLED=0", "COUPLED=0: give 1, or leave it out"),
        ("WHOLE=no", "WHOLE=no: give 1, or leave it out"),
        ("RETRIES=-1", "RETRIES=-1: give a whole number of 0 to 999999"),
        ("SNAKEFLAGS=-n;touch pwned", "SNAKEFLAGS has the letter ; in it"),
        ("PRESSURE=21;touch pwned", "PRESSURE has the letter ; in it"),
        ("SCENE=goood", "SCENE=goood: no such scene; "),
        ("goood", "goood: no such scene or target; "),
        ("go'od", "the target has the letter ' in it"),
        ("good.vortex", "good.vortex: no such scene or target; "),
        ("NP=2;touch pwned", "NP has the letter ; in it"),
        ("ACCURACY=1%;touch pwned", "ACCURACY has the letter ; in it"),
        ('BUDGET=1"`touch pwned`', 'BUDGET has the letter " in it'),
        ("LEVEL=$(shell touch pwned)", "LEVEL has the letter ( in it"),
        ("HOSTS=a&b", "HOSTS has the letter & in it"),
        ("STUDY=missing.csv", "STUDY=missing.csv: no such file; give a table"),
        ("OPENFOAM=/opt/x", "OPENFOAM: no such switch; "),
        ("LEVLE=smoke", "LEVLE: no such switch; "),
    ],
)
def test_what_is_given_is_checked_before_anything_is_made(project, word, sentence):
    done = make(project, "study" if word.startswith("STUDY") else "good", word)
    assert done.returncode == 2
    assert sentence in done.stderr
    assert done.stdout == ""
    assert not (project / "pwned").exists()


@pytest.mark.parametrize(
    "switch, goes_with", [("COUPLED", "a whole scene"), ("SLURM", "a whole scene or a study")]
)
def test_a_switch_that_goes_with_a_whole_scene_is_refused_with_a_stage(project, switch, goes_with):
    done = make(project, "good.run", f"{switch}=1")
    assert f"{switch}=1 goes with {goes_with}, not with one stage" in done.stderr


def test_a_misspelt_scene_is_told_with_the_nearest():
    done = make(ROOT, "singel_finger")
    assert (
        "singel_finger: no such scene or target; did you mean single_finger? make help"
        in done.stderr
    )
    done = make(ROOT, "single_finger", "LEVLE=smoke")
    assert "LEVLE: no such switch; did you mean LEVEL? make help" in done.stderr


def test_an_openfoam_that_is_not_there_is_told_before_anything_is_made():
    done = make(ROOT, "single_finger", "READY=Makefile", "WM_PROJECT_DIR=/missing")
    assert (done.returncode, done.stdout) == (2, "")
    assert "WM_PROJECT_DIR = /missing: there is no etc/bashrc; give" in done.stderr


@pytest.mark.parametrize("words", [["NP=007"], ["RETRIES=0"], ["SCENE=good", "PRESSURE=21.5"]])
def test_numbers_that_are_some_pass(project, words):
    assert make(project, "good", *words).returncode == 0


@pytest.mark.parametrize(
    "deleted, made",
    [
        ("vortices_cfd.csv", "vortices_cfd compare figures report"),
        ("loads.h5", "loads figures report"),
        ("comparison.json", "compare figures report"),
        ("images.h5", ""),
        ("run/run.json", ""),
    ],
)
def test_a_small_file_that_was_deleted_is_made_again_and_a_large_one_is_not(
    tmp_path, deleted, made
):
    project = checkout(tmp_path)
    out = project / "cases" / "good" / "out" / "coarse"
    needs = [line.split(" := ")[1].split() for line in (ROOT / "fileio" / "stages.mk").read_text().splitlines() if line.startswith("NEEDS.")]  # fmt: skip
    settings = sorted({name for names in needs for name in names if name.startswith("settings/")})
    files = ["settings/.stamp", *settings, *(stage.done for stage in STAGES)]
    for k, name in enumerate(files):  # newer than the checkout, each than the one before
        (out / name).parent.mkdir(parents=True, exist_ok=True)
        (out / name).touch()
        os.utime(out / name, (time.time() + k,) * 2)
    assert "-m pipeline" not in make(project, "READY=Makefile", "good").stdout
    (out / deleted).unlink()
    done = make(project, "READY=Makefile", "good")
    assert re.findall(r"-m pipeline (\w+) cases/good", done.stdout) == made.split()


@pytest.mark.parametrize("target", ["compare", "compare-measured", "compare-coupled"])
def test_the_laboratory_folder_is_looked_for_before_anything_is_made(project, target):
    done = make(project, target, "SCENE=good", "DPIV=/missing")
    assert (done.returncode, done.stdout) == (2, "")
    assert "DPIV=/missing: holds no dpiv.toml" in done.stderr


@pytest.mark.parametrize("name", ["with space", "it's", 'quo"te', "do$$llar"])
def test_a_path_that_a_shell_reads_otherwise_is_refused_at_once(tmp_path, name):
    done = make(checkout(tmp_path / name), "help")
    assert done.returncode == 2
    assert "move the project to a path without" in done.stderr


def test_a_path_in_other_letters_is_none_of_these(tmp_path):
    assert make(checkout(tmp_path / "Größe-測定"), "good").returncode == 0


def test_without_a_network_the_set_up_ends_soon_in_one_sentence(tmp_path):
    (tmp_path / "pipeline").mkdir()
    shutil.copy(ROOT / "pipeline" / "setup.sh", tmp_path / "pipeline")
    (tmp_path / "requirements.lock").write_text(
        "no-such-package==1.0 --hash=sha256:" + "0" * 64 + "\n"
    )
    env = os.environ | {"PIP_INDEX_URL": "http://127.0.0.1:9/simple", "PIP_NO_CACHE_DIR": "1", "PIP_CONFIG_FILE": os.devnull}  # fmt: skip
    done = subprocess.run(
        ["sh", "pipeline/setup.sh"],
        cwd=tmp_path,
        env=env,
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert done.returncode == 1
    said = done.stderr.splitlines()
    assert said[-1] == (
        "setup: cannot install the Python packages; with a network to fetch them from, run make setup again"
    )
    assert len(said) <= 2  # before it what pip says
    assert not (tmp_path / ".venv" / "requirements.lock").exists()  # it is not taken for installed
