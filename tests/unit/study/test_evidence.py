"""The tables of the documentation are of this code, and one command makes them."""

import json
import re
import subprocess
import sys
import time
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path

import pandas as pd
import pytest

from docs.evidence import __main__ as evidence
from docs.evidence import twin
from pipeline.runs.stages import BY_NAME, COUPLED
from softfinger.study import table
from softfinger.study.rows import read_study
from softfinger.study.table import origin
from tests.conftest import CASES, ROOT

TABLES = [*(ROOT / "docs").rglob("*.csv"), *(ROOT / "cases").glob("*/studies/results/*.csv")]
OF_NO_STAGE = {"deforming_mesh", "ringdown"}  # checks of a case of their own, and of recordings
CODE = {name: stage.version for name, stage in BY_NAME.items()}
CODE |= {f"{name}_coupled": stage.version for name, stage in COUPLED.items()}


def head_of(path):
    """The first line of a table that states what it was made from; {} of another."""
    with path.open(encoding="utf-8") as file:
        first = file.readline()
    return json.loads(first[1:]) if first.startswith("# {") else {}


def test_tables_state_the_stages_of_this_code():
    """Where one fails, make it anew: the head of each table says which stages it used."""
    heads = {str(path.relative_to(ROOT)): head_of(path) for path in TABLES}
    made = {path: head for path, head in heads.items() if head}
    assert made
    for path, head in made.items():
        assert head["commit"], path
        assert head["stages"] == {name: CODE[name] for name in head["stages"]}, path


def test_checks_state_the_stages_of_this_code():
    for path in (ROOT / "docs" / "verification").glob("*.json"):
        result = json.loads(path.read_text(encoding="utf-8"))
        if path.stem not in OF_NO_STAGE:
            stages = result["provenance"]["stages"]
            assert result["commit"], path
            assert stages == {name: CODE[name] for name in stages}, path


def test_numbers_of_scenes_state_the_stages_of_this_code():
    for path in (ROOT / "docs" / "scenes").glob("*_run.csv"):
        stated = pd.read_csv(path, index_col="run")["value"]
        stages = dict(pair.split() for pair in stated["stages"].split(", "))
        assert stages == {name: str(CODE[name]) for name in stages}, path
        assert re.search(r"commit \w{8}", stated["made"]), path


@pytest.fixture
def night(tmp_path, monkeypatch):
    """A function that makes the Night of parts of given commands, whose table is in tmp_path."""
    monkeypatch.setattr(evidence, "STATE", tmp_path / "state")
    monkeypatch.setattr(evidence, "TABLE", tmp_path / "parts.csv")
    (tmp_path / "parts.csv").write_text("part,cpu_h,from,made,commit\na,2.00,whole,,\n")

    def make(texts, at="abc", **after):
        parts = {
            name: evidence.Part(((sys.executable, "-c", text),), after.get(name, ()))
            for name, text in texts.items()
        }
        return evidence.Night(parts, at)

    return make


def test_a_night_runs_each_part_once_after_those_that_it_reads(night, tmp_path, capsys):
    log = tmp_path / "log"
    write = "open({!r}, 'a').write({!r})"
    texts = {name: write.format(str(log), name) for name in "abc"} | {"d": "raise SystemExit(3)"}
    after = {"a": ("b",), "b": ("c",)}
    first = night(texts, **after)
    # a part whose last cost is not known is not taken for free
    assert first.left(first.due()) == "about 2.0 h and b, c, d"
    assert first.run() == ["d"]
    assert log.read_text() == "cba"
    assert re.search("d FAILED, .* left\n", capsys.readouterr().out)
    table = pd.read_csv(evidence.TABLE, index_col="part", dtype=str)
    # of a part whose runs were there the last cost stays; a failed one is not written
    assert table.loc["a", ["cpu_h", "from", "commit"]].to_list() == ["2.00", "whole", "abc"]
    assert set(table.index) == {"a", "b", "c"}
    # what has failed is tried again, and nothing else; on another commit all is due
    texts["d"] = write.format(str(log), "d")
    for at, made in (("abc", "cbad"), ("def", 2 * "abcd")):
        assert night(texts, at, **after).run() == []
        assert sorted(log.read_text()) == sorted(made)
    # the code of "dirty", or without git, is not known; a name is run again
    for at in ("def-dirty", "def-dirty", "", "", "def"):
        replace(night({"a": texts["a"]}, at), again=at == "def").run()
    assert log.read_text().count("a") == 7
    # a part that has ended is run again for one that reads its runs, as in a new clone
    night(texts | {"e": write.format(str(log), "e")}, "def", **after, e=("a",)).run()
    assert log.read_text().endswith("cbae")


def test_a_night_that_is_interrupted_ends_its_parts_and_begins_none(night, tmp_path):
    begun, child = tmp_path / "begun", tmp_path / "child"
    # once the second has started a process of its own
    wait = f"import os, time\nwhile not os.path.exists({str(child)!r}): time.sleep(0.1)\n"
    texts = {"a": f"{wait}os.kill(os.getppid(), 2); time.sleep(60)"}
    texts |= {"b": f"import os; os.system('sleep 60 & echo $! > {child}; wait')"}
    texts |= {"c": f"open({str(begun)!r}, 'w')"}
    start = time.monotonic()
    with pytest.raises(KeyboardInterrupt):
        night(texts).run()
    assert time.monotonic() - start < 30  # of the 60 s that its parts would take
    assert not begun.exists()
    assert not evidence._RUNNING
    process = Path(f"/proc/{child.read_text().strip()}")
    while process.exists() and time.monotonic() < start + 30:  # until its new parent has seen it
        time.sleep(0.1)
    assert not process.exists()


def test_the_parts_of_the_evidence_are_commands_that_exist():
    for name, part in evidence.PARTS.items():
        assert set(part.after) <= evidence.PARTS.keys(), name
        for words in part.commands:
            if words[1] == "-m":
                assert find_spec(words[2]), words
            if words[1] == "study":
                assert (ROOT / words[2]).exists(), words
    assert set(pd.read_csv(ROOT / evidence.TABLE)["part"]) <= evidence.PARTS.keys()


def test_measured_pressures_that_rows_of_studies_name_are_there():
    rows = read_study(CASES / "single_finger" / "studies" / "stability.csv")
    files = [row.overrides.get("motion.pressure_csv") for row in rows]
    named = [file for file in files if file]
    assert len(named) == 5
    assert all((CASES / "single_finger" / file).exists() for file in named)


@pytest.mark.parametrize("source, names", [("fea", {"solve"}), ("structure", {"solve_coupled"})])
def test_the_head_of_a_table_names_the_stages_that_its_runs_used(tmp_path, source, names):
    row = {"folder": str(CASES / "single_finger"), "level": "smoke", "until": "sheet"}
    row |= {"overrides": {"motion.source": source}, "out": str(tmp_path), "compared_ranks": None}
    refused = row | {"overrides": {"mesh.wall_cell": 0.008}}
    found = origin([row, refused])
    assert names <= found["stages"].keys()
    assert {"sheet"} <= found["stages"].keys()
    assert {"images"}.isdisjoint(found["stages"])
    assert len(found["made"]) == len("2026-11-28")


def test_no_seed_that_the_twin_was_tuned_with_counts_as_blind(monkeypatch, capsys):
    assert twin.TUNED.isdisjoint(pd.read_csv(ROOT / twin.TABLE)["seed"])
    for words in evidence.PARTS["twin"].commands:
        first, end = map(int, words[3:5])
        assert twin.TUNED.isdisjoint(range(first, end)), words
    monkeypatch.setattr(sys, "argv", ["twin", "8", "10"])
    with pytest.raises(SystemExit):
        twin.main()
    assert "seeds [9] are not blind" in capsys.readouterr().err


def test_evidence_belongs_to_the_last_commit_of_code(tmp_path, monkeypatch):
    """A commit of docs or tests made a night of runs due again; one of a scheme did not."""
    monkeypatch.setattr(table, "__file__", str(tmp_path / "softfinger" / "study" / "table.py"))
    names = []
    for file in ("piv/a.py", "docs/a.md", "tests/test_a.py", "cases/_base/system/fvSchemes"):
        (tmp_path / file).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / file).write_text(file)
        for words in (["init", "-q"], ["add", "."], ["commit", "-qm", file]):
            user = ["-c", "user.name=a", "-c", "user.email=a@b"]
            subprocess.run(["git", *user, *words], cwd=tmp_path, check=True)
        names.append(table.commit())
    assert names[0]
    assert names[0] == names[1] == names[2] != names[3]
    (tmp_path / "piv" / "a.py").write_text("other")
    assert table.commit() == f"{names[3]}-dirty"
