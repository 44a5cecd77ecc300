"""The one command line: exit codes, sentences, costs, and stages found through the table."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from piv.__main__ import main as piv
from piv.files.command import command_line, guarded
from piv.files.errors import StageError
from piv.files.lock import exclusive
from softfinger.__main__ import app, main
from tests.conftest import ROOT, write_scene

INTERRUPTED = "interrupted; run it again to go on: what is finished is kept\n"


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
        (StageError("a.h5: x is missing; make it"), 2, "p act: a.h5: x is missing; make it\n"),
        (FileNotFoundError(2, "No such file", "a.h5"), 2, "p act: a.h5: No such file\n"),
        (ValueError("a.h5: no number"), 2, "p act: a.h5: no number\n"),
        (KeyboardInterrupt(), 130, f"p act: {INTERRUPTED}"),
        # an escape sequence, a line that overwrites another, and text from right to left
        (StageError("a\x1b[2J\u202e: bad"), 2, "p act: a\ufffd[2J\ufffd: bad\n"),
        (FileNotFoundError(2, "No file", "a\r\x9b"), 2, "p act: a\ufffd\ufffd: No file\n"),
    ],
)
def test_how_a_command_ends(end, code, said, capsys):
    assert command_line("p", None, {"act": ("act", Command(end))}, ["act"]) == code
    assert capsys.readouterr().err == said


@pytest.mark.parametrize(
    "given, said",
    [
        ("corelate", "corelate: no such command; did you mean correlate? (--help lists what may"),
        ("xyz", "xyz: no such command (--help lists what may be given)"),
        ("correlate a b -o c.h5 --windw 24", "--windw 24; did you mean --window?"),
        ("correlate a b -o c.h5 --xyz", "unrecognized arguments: --xyz (--help"),
    ],
)
def test_a_misspelt_command_or_option_is_told_with_the_nearest(given, said, capsys):
    with pytest.raises(SystemExit) as ended:
        piv(given.split())
    assert ended.value.code == 2
    told = capsys.readouterr().err
    assert said in told
    assert told.count("\n") == 1  # one sentence, without the usage


def test_an_option_that_only_the_help_speaks_of_is_not_proposed(capsys):
    command = Command(None)
    told = "as --long-depth of other commands"
    command.add_arguments = lambda parser: parser.add_argument("--width", help=told)
    for given, end in (("--long-dept", ""), ("--widht", "; did you mean --width?")):
        with pytest.raises(SystemExit):
            command_line("p", None, {"act": ("act", command)}, ["act", given])
        assert f"unrecognized arguments: {given}{end} (--help" in capsys.readouterr().err


def test_what_a_command_prints_of_files_steers_no_terminal(capsys):
    command = Command(None)
    command.run = lambda args: print("title\x1b]0;x\x07\tof a\r\u2066 scene")
    assert command_line("p", None, {"act": ("act", command)}, ["act"]) == 0
    assert capsys.readouterr().out == "title\ufffd]0;x\ufffd\tof a\ufffd\ufffd scene\n"


def test_a_defect_keeps_its_traceback():
    def defect():
        raise ValueError("operands could not be broadcast together")

    with pytest.raises(ValueError, match="operands"):
        guarded("mesh", defect, strict=True)
    with pytest.raises(KeyError):
        guarded("mesh", lambda: {}["a"])


@pytest.mark.parametrize("name", [name for name in app if not name.startswith("-")])
def test_every_command_has_a_help(name, capsys):
    assert main([name, "--help"]) == 0
    assert name in capsys.readouterr().out


@pytest.mark.parametrize(
    "words, part",
    [
        (["rn"], 'Did you mean "run"?'),
        (["run", "cases/single_finger", "--levl", "smoke"], "Did you mean --level?"),
        (["run", "cases/singel_finger"], "did you mean single_finger?"),
        (["run", "cases/single_finger", "--until", "mash"], "mash: no such stage"),
        (["run", "cases/single_finger", "--set", "mesh.tip_cell"], "give KEY=VALUE"),
        (["run", "cases/single_finger", "--set", "mesh.tip_cel=1"], "tip_cell"),
        (["run", "cases/single_finger", "--name", "x"], "--name needs --set"),
        (["new", "cases/single_finger"], "exists already"),
        (["run", "cases/single_finger", "--hosts", "no.txt"], "--hosts no.txt: no such file"),
    ],
)
def test_wrong_words_are_one_sentence(words, part, capsys):
    assert main(words) == 2
    text = capsys.readouterr().err
    assert part in text
    assert text.count("\n") == 1


def test_a_stage_is_made_and_a_dry_run_makes_nothing(tmp_path, capsys):
    scene = write_scene(tmp_path / "small")
    words = ["run", str(scene.folder), "--level", "tiny", "--until", "kinematics"]
    assert main([*words, "--dry-run"]) == 0
    assert capsys.readouterr().out == "kinematics: not made yet\nabout 2 s of CPU time\n"
    assert main(["run", str(scene.folder), "--level", "tiny", "--dry-run"]) == 0
    assert "\nthe flow: about 700 cells, 420 steps, " in capsys.readouterr().out
    assert not scene.out.exists()
    assert main([*words, "--quiet"]) == 0
    assert main([*words, "--dry-run"]) == 0
    assert capsys.readouterr().out == "nothing to do\n"
    assert main([*words, "--set", "finger.tilt_deg=3.0", "--name", "tilted", "--quiet"]) == 0
    assert (scene.folder / "out" / "variations" / "tilted" / "kinematics.h5").exists()


@pytest.mark.parametrize("words", [["{pipe}"], ["--view", "{pipe}"], ["-o", "/dev/full"]])
def test_a_pipe_or_a_device_is_no_file(tmp_path, words, capsys):
    os.mkfifo(tmp_path / "pipe")

    class Reader:
        def add_arguments(self, parser):
            parser.add_argument("source", nargs="?", default="fast")
            parser.add_argument("--view", nargs="+")
            parser.add_argument("-o", "--output", type=Path)

        def run(self, args):
            raise AssertionError("it was read or replaced")

    words = [word.format(pipe=tmp_path / "pipe") for word in words]
    assert command_line("p", None, {"act": ("act", Reader())}, ["act", *words]) == 2
    told = f"p act: {words[-1]}: is neither a file nor a folder; give another name\n"
    assert capsys.readouterr().err == told


def test_a_console_that_knows_no_such_letter_does_not_end_a_stage():
    code = "from piv.files.command import guarded\n"
    code += "raise SystemExit(guarded('mesh', lambda: print('640×512 … µm')))"
    command, env = [sys.executable, "-c", code], os.environ | {"PYTHONIOENCODING": "ascii"}
    done = subprocess.run(command, cwd=ROOT, env=env, capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout == "640?512 ? ?m\n"


@pytest.mark.parametrize("module, library", [
    ("softfinger", "_multiarray_umath"), ("softfinger", "libhdf5"), ("softfinger", "pydantic_core"),
])  # fmt: skip
def test_an_interrupt_during_the_imports_is_one_sentence(module, library):
    """Also within those of libraries, which make errors of their own of it."""
    process = subprocess.Popen(
        [sys.executable, "-m", module, "run", "cases/single_finger", "--dry-run"], cwd=ROOT,
        text=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    )  # fmt: skip
    while process.poll() is None and library not in Path(f"/proc/{process.pid}/maps").read_text():
        pass
    process.send_signal(signal.SIGINT)
    said = process.communicate(timeout=60)
    assert (process.returncode, *said) == (130, "", INTERRUPTED)


def test_an_interrupt_that_a_library_takes_for_its_own_error_is_one(capsys):
    def imports() -> None:
        try:
            raise KeyboardInterrupt
        except KeyboardInterrupt:
            raise ImportError("the module cannot be loaded") from None

    assert guarded("mesh", imports, strict=True) == 130
    assert capsys.readouterr().err == f"mesh: {INTERRUPTED}"


def test_workers_end_at_ctrl_c_without_a_word(tmp_path):
    """Also while they import: the signal comes to the whole group, as from a terminal."""
    (tmp_path / "slow.py").write_text(
        "import time\n"
        "from piv.files.child_process import worker_pool\n"
        "def work():\n    time.sleep(60)\n"
        "def main():\n"
        "    with worker_pool(2) as pool:\n"
        "        print('started', flush=True)\n"
        "        pool.submit(work).result()\n"
        "from piv.files.command import guarded\n"
        "if __name__ == '__main__':\n    raise SystemExit(guarded('work', main))\n"
    )
    env = os.environ | {"PYTHONPATH": str(ROOT)}
    process = subprocess.Popen(
        [sys.executable, str(tmp_path / "slow.py")], env=env, text=True, start_new_session=True,
        stdout=subprocess.PIPE, stderr=subprocess.PIPE,
        # a job in the background of a shell ignores Ctrl-C, and so would what it starts
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )  # fmt: skip
    assert process.stdout.readline() == "started\n"  # while the workers still import
    os.killpg(process.pid, signal.SIGINT)
    said = process.communicate(timeout=60)[1]
    assert process.returncode == 130
    assert said == f"work: {INTERRUPTED}"


def test_a_folder_that_does_not_exist_is_named(tmp_path):
    path = tmp_path / "none" / "a.h5"
    with pytest.raises(FileNotFoundError, match="make it first"), exclusive(path):
        pass


@pytest.mark.parametrize("streams", [">&-", "2>&-", ">&- 2>&- <&-"])
def test_closed_streams_are_no_fault(tmp_path, streams):
    command = f"{sys.executable} -m softfinger stages {streams}"
    done = subprocess.run(["sh", "-c", command], cwd=ROOT, capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.parametrize("program", ["softfinger", "piv"])
def test_too_low_a_limit_of_memory_is_one_sentence(program):
    """OpenBLAS interrupts a process that may start no thread, which said "run it again"."""
    command = f"ulimit -v 350000; exec {sys.executable} -m {program} --help"
    done = subprocess.run(["sh", "-c", command], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 2
    assert done.stderr == "not enough memory: ulimit -v gives 358 MB; give at least 2000\n"
