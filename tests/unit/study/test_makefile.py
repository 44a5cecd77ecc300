"""The Makefile: a façade that lists its targets and hands every name and value to the program."""

import re
import subprocess
from pathlib import Path

import pytest

from tests.conftest import CASES, ROOT
from tests.inner_make import inner_environment

TEXT = (ROOT / "Makefile").read_text(encoding="utf-8")
TARGETS = set(re.findall(r"(?m)^([a-z][a-z-]*):(?!=).*##", TEXT))
SCENES = {path.parent.name for path in CASES.glob("*/scene.toml")}


def make(*words: str, folder: Path = ROOT) -> subprocess.CompletedProcess[str]:
    command = ["make", "--no-print-directory", *words]
    return subprocess.run(
        command, cwd=folder, capture_output=True, text=True, check=False, env=inner_environment()
    )


def test_help_lists_every_target_and_scene() -> None:
    text = make("help").stdout
    assert set(re.findall(r"(?m)^make ([a-z-]+) ", text)) >= TARGETS
    assert len(TARGETS) <= 19  # short enough to be read: a screen with the scenes
    assert all(scene in text for scene in SCENES)


def test_the_makefile_is_short() -> None:
    lines = TEXT.splitlines()
    assert len(lines) <= 150
    assert max(map(len, lines)) <= 100


def test_what_the_readme_and_the_docs_tell_to_make_is_there() -> None:
    """Finished studies in docs/record name targets of their time."""
    pages = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *(ROOT / "docs").glob("*.md")]
    for page in pages:
        named = set(re.findall(r"`make ([a-z][a-z_.-]*)", page.read_text(encoding="utf-8")))
        assert {name.split(".")[0] for name in named} <= TARGETS | SCENES | {"slurm_test"}, page


@pytest.mark.parametrize(
    "words, sentence",
    [
        (["singel_finger"], "did you mean single_finger?"),
        (["single_finger.msh"], "did you mean single_finger.mesh?"),
        (["single_finger", "LEVLE=smoke"], "LEVLE: no such value"),
        (["single_finger", "LEVEL=smok"], "did you mean smoke?"),
        (["single_finger", "LEVEL=smoke", "NP=0"], "NP=0: give 1 or more"),
        (["single_finger", "COUPLED=maybe"], 'unable to convert "maybe": give 1 or 0'),
        (["single_finger", "COUPLED=1", "BUDGET=1min"], "COUPLED goes with a whole scene, not wi"),
        (["single_finger", "PIV=0", "BUDGET=1min"], "PIV goes with a whole scene, not with BUD"),
        (["fea", "PIV=0"], "fea does not use PIV"),
        (["single_finger", "ACCURACY=many"], "ACCURACY=many: give a share"),
        (["fea", "SCENE=pinsh"], "did you mean pinch?"),
        (["study", "STUDY=no.csv"], "no.csv: no such file; give a table of the columns run"),
        (["study"], "give STUDY=table.csv"),
        (["single_finger.mesh", "DPIV=here"], "run does not use DPIV; omit it"),
        (["fea", "COUPLED=1"], "fea does not use COUPLED"),
        (["study", "NP=1"], "give STUDY=table.csv"),
        (["single_finger", "SCENE=pinch"], "run does not use SCENE; omit it"),
        (["tradeoff", "STUDY=x.csv", "DOCS=pinch"], "tradeoff does not use"),
        (["lint", "LEVEL=smoke"], "lint does not use LEVEL; omit it"),
        (["park", "LEVEL=smoke"], "park does not use LEVEL; omit it"),
        (["single_finger", 'LEVEL=$$(touch made; echo "smoke)'], "no level"),
        (["single_finger", "LEVEL=$(shell touch made)"], "no level '$(shell touch made)'"),
        (["fea", "SCENE=;touch made;"], "cases/;touch made;: no such scene"),
        (["tradeoff", "SCENE=`touch made`"], "cases/`touch made`: no such scene"),
        (["study", "STUDY=$(shell touch made).csv"], "$(shell touch made).csv: no such file"),
        (["x'; touch made; '"], "x'; touch made; ': no such scene or target"),
    ],
)
def test_a_wrong_name_or_value_is_one_sentence(words: list[str], sentence: str) -> None:
    """The program checks it before anything is made; a shell reads nothing of it."""
    done = make(*words)
    assert done.returncode == 2
    assert sentence in done.stderr
    assert "Traceback" not in done.stderr
    assert not (ROOT / "made").exists()


def test_names_of_folders_are_no_commands(tmp_path: Path) -> None:
    """One such folder made every target fail, or its name was run at a bare make."""
    (tmp_path / "Makefile").write_text(TEXT)
    ready = tmp_path / ".venv"
    (ready / "bin").mkdir(parents=True)
    for name in ("softfinger", "python"):
        (ready / "bin" / name).write_text('#!/bin/sh\necho "$@"')
        (ready / "bin" / name).chmod(0o755)
    (ready / ".ready").touch()
    odd = ["a$(touch${IFS}made)b", "a$(shell touch made)b", "a:b", "q;touch made", "a b", "o'br"]
    odd += ['q"q', "a\nb", "a%", "`touch made`", "clean", "a#b", "a=b"]
    for name in ["good", "also-good.2", *odd]:
        (tmp_path / "cases" / name).mkdir(parents=True)
        (tmp_path / "cases" / name / "scene.toml").write_text('extends = "../good"\n')
    for name in ("requirements.lock", "softfinger/setup.sh", "softfinger/command.sh"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).touch()
    (ready / ".ready").touch()
    for words in ([], ["good"], ["also-good.2"], ["clean"], ["a b"], ["fea", "SCENE=a:b"]):
        done = make(*words, folder=tmp_path)
        assert done.returncode == 0, done.stderr
        assert not list(tmp_path.rglob("made"))
        assert all(f"cases/{name}".split()[0] in done.stderr for name in odd if "\n" not in name)
        assert "left out; rename the folder" in done.stderr
    assert "run cases/good" in make("good", folder=tmp_path).stdout
    assert "fea cases/a:b" in make("fea", "SCENE=a:b", folder=tmp_path).stdout


def test_a_first_run_sets_up_whatever_its_values_are(tmp_path: Path) -> None:
    """Commands of the set-up do not use LEVEL, which would be an error of the user's otherwise."""
    (tmp_path / "softfinger").mkdir()
    for name in ("Makefile", "requirements.lock", "softfinger/command.sh"):
        (tmp_path / name).write_text((ROOT / name).read_text())
    (tmp_path / "softfinger" / "setup.sh").write_text('mkdir -p .venv; echo "typed: $TYPED."')
    done = make("setup", "LEVEL=smoke", folder=tmp_path)
    assert (done.returncode, done.stdout) == (0, "typed: .\n")
