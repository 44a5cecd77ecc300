"""The one command line: exit codes, sentences, costs, and stages found through the table."""

import json

import pytest

from fileio.command import command_line, guarded
from fileio.errors import StageError
from fileio.stages import BY_NAME
from pipeline.__main__ import TOOLS, main
from tests.conftest import write_scene


class Command:
    """Raises what it was given, or ends with it as its exit code."""

    def __init__(self, end):
        self.end = end

    def run(self, args):
        if isinstance(self.end, BaseException):
            raise self.end
        return self.end


@pytest.mark.parametrize(
    "end, code, said",
    [
        (None, 0, ""),
        (2, 2, ""),
        (StageError("a.h5: x is missing; make it again"), 2, "p act: a.h5: x is missing; make it again\n"),
        (FileNotFoundError(2, "No such file", "a.h5"), 2, "p act: a.h5: No such file\n"),
        (ValueError("a.h5: no number"), 2, "p act: a.h5: no number\n"),
        (KeyboardInterrupt(), 130, "p act: interrupted; run it again to go on: what is finished is kept\n"),
    ],
)
def test_how_a_command_ends(end, code, said, capsys):
    assert command_line("p", None, {"act": ("act", Command(end))}, ["act"], prefix="p ") == code
    assert capsys.readouterr().err == said


def test_a_defect_keeps_its_traceback():
    def defect():
        raise ValueError("operands could not be broadcast together")

    with pytest.raises(ValueError, match="operands"):
        guarded("mesh", defect, strict=True)
    with pytest.raises(KeyError):
        guarded("mesh", lambda: {}["a"])


def test_help_names_every_stage_and_tool(capsys):
    with pytest.raises(SystemExit) as ended:
        main(["--help"])
    assert ended.value.code == 0
    said = capsys.readouterr().out
    assert all(f"\n    {name}" in said for name in (*BY_NAME, *TOOLS))


@pytest.mark.parametrize("name", [*BY_NAME, *TOOLS])
def test_every_command_says_its_arguments(name, capsys):
    with pytest.raises(SystemExit) as ended:
        main([name, "--help"])
    assert ended.value.code == 0
    assert name in capsys.readouterr().out


def test_a_stage_records_its_cost_where_it_ends_well(tmp_path, capsys):
    scene = write_scene(tmp_path / "small")
    given = [str(scene.folder), "--level", "tiny", "--quiet"]
    assert main(["settings", *given]) == 0
    assert main(["kinematics", *given]) == 0
    cost = json.loads((scene.out / "costs" / "kinematics.json").read_text())
    assert cost["stage"] == "kinematics"
    assert cost["cpu_time"] > 0
    assert (scene.out / "kinematics.h5").exists()
    for stage, said in (("sheet", "run"), ("images", "sheet.h5"), ("report", "comparison.json")):
        capsys.readouterr()
        assert main([stage, *given]) == 2, stage
        complaint = capsys.readouterr().err
        assert said in complaint
        assert complaint.count("\n") == 1
        assert not (scene.out / "costs" / f"{stage}.json").exists()


def test_a_level_that_was_not_run_is_one_sentence(tmp_path, capsys):
    scene = write_scene(tmp_path / "small")
    assert main(["report", str(scene.folder), "--level", "medium"]) == 2
    assert "nothing was run at level medium" in capsys.readouterr().err
    assert not (scene.folder / "out" / "medium").exists()
