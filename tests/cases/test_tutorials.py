"""The tutorials' commands give what the pages show.

A block after a line that names a file is that file, `sh` and `python` blocks are run, and the lines
of a `text` block are in the output of the block before it, in order; `…` stands for anything.
"""

import re
import shutil
import subprocess
import sys
import venv
from pathlib import Path

import pytest

from tests.conftest import ROOT
from tests.inner_make import inner_environment

TUTORIALS = ROOT / "docs" / "tutorials"
BLOCK = re.compile(r"(?m)^(?:`(?P<file>[^`\n]+)`:\n)?```(?P<kind>\w+)\n(?P<body>(?s:.*?))^```$")


@pytest.fixture
def clone(project, tmp_path):
    shutil.copytree(project, tmp_path / "clone", symlinks=True)
    shutil.copytree(TUTORIALS, tmp_path / "clone" / "docs" / "tutorials")
    return tmp_path / "clone"


def run(command: list[str], folder: Path) -> str:
    """Output of a command, which must succeed; its make needs no set-up."""
    environment = inner_environment(MPLBACKEND="Agg")
    environment["PATH"] = f"{folder / '.venv' / 'bin'}:{environment['PATH']}"
    done = subprocess.run(
        command, cwd=folder, env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, f"{command}\n{done.stdout[-2000:]}{done.stderr[-3000:]}"
    assert "jobserver" not in done.stderr  # make's own warning, of a make within make
    return done.stdout + done.stderr


def follow(page: str, folder: Path) -> int:
    """Do the steps of a page; the number of its commands that run something."""
    printed, commands = "", 0
    text = (TUTORIALS / page).read_text(encoding="utf-8")
    for block in BLOCK.finditer(text):
        kind, body = block["kind"], block["body"]
        if block["file"]:
            (folder / block["file"]).parent.mkdir(parents=True, exist_ok=True)
            (folder / block["file"]).write_text(body, encoding="utf-8")
        elif kind == "sh":
            printed = run(["sh", "-ec", body], folder)
            commands += len(re.findall(r"(?m)^(make|piv) ", body))
        elif kind == "python":
            printed = run([sys.executable, "-c", body], folder)
        else:
            assert kind == "text", f"{page}: a block of kind {kind}"
            expect(body.splitlines(), printed, page)
    assert len(BLOCK.findall(text)) == len(re.findall(r"(?m)^```\w", text))
    return commands


def expect(lines: list[str], printed: str, page: str) -> None:
    rest = printed
    for line in lines:
        pattern = ".*".join(re.escape(part) for part in line.split("…"))
        match = re.search(rf"(?m)^{pattern}$", rest)
        assert match, f"{page} shows\n{line}\nbut it prints\n{printed}"
        rest = rest[match.end() :]


def test_a_wrong_page_is_found():
    expect(["a … c", "last"], "x\na b c\nlast\n", "page")
    for lines in (["last", "a b c"], ["a c"], ["b"]):
        with pytest.raises(AssertionError):
            expect(lines, "x\na b c\nlast\n", "page")


def test_piv_of_two_images_and_of_a_recording(clone):
    assert follow("piv.md", clone) == 1 + 4
    assert (clone / "tutorial" / "picture.png").stat().st_size > 10_000


def test_the_command_piv_works_in_any_folder(tmp_path):
    """Beside folders with the names of the project's own packages."""
    (tmp_path / "piv").mkdir()
    (tmp_path / "piv" / "__init__.py").write_text("raise SystemExit('not this one')")
    frames = [str(TUTORIALS / "frames" / f"frame_{k}.png") for k in (0, 1)]
    command = [ROOT / ".venv" / "bin" / "piv", "correlate", *frames, "-o", "pair.h5"]
    subprocess.run([*command, "--window", "24"], cwd=tmp_path, env=inner_environment(), check=True)
    assert (tmp_path / "pair.h5").is_file()


def test_the_command_piv_runs_the_clone_that_it_is_called_in(tmp_path):
    """Also in a clone with a linked environment, through a link to the command, after a move."""
    one, two = tmp_path / "one", tmp_path / "two"
    for clone in (one, two):
        (clone / "piv").mkdir(parents=True)
        (clone / "piv" / "__init__.py").write_text(f"name = {clone.name!r}")
        (clone / "piv" / "__main__.py").write_text("import piv; print(piv.name)")
    venv.create(one / ".venv", symlinks=True)
    subprocess.run(["sh", ROOT / "softfinger" / "command.sh", one / ".venv"], check=True)
    (two / ".venv").symlink_to(one / ".venv")
    (tmp_path / "linked").symlink_to(one / ".venv" / "bin" / "piv")

    def output(*command):
        options = {"cwd": tmp_path, "capture_output": True, "text": True, "check": True}
        return subprocess.run(command, **options).stdout.strip()

    assert output(one / ".venv" / "bin" / "piv") == "one"
    assert output(two / ".venv" / "bin" / "piv") == "two"
    assert output(two / ".venv" / "bin" / "python", "-c", "import piv; print(piv.name)") == "two"
    assert output(tmp_path / "linked") == "one"
    one.rename(tmp_path / "three")
    assert output(tmp_path / "three" / ".venv" / "bin" / "piv") == "one"


@pytest.mark.openfoam
@pytest.mark.slow
def test_an_own_finger_and_its_recording(clone):
    assert follow("own_finger.md", clone) <= 4
    out = clone / "cases" / "my_finger" / "out" / "smoke"
    page = (out / "report.html").read_text(encoding="utf-8")
    assert len(page) > 100_000
    assert "Pressure and water make the finger" in page
    assert "motion is prescribed" not in page
    assert "of the work is unexplained" in page
    follow("comparison.md", clone)
