"""The tables of the documentation are of this code."""

import json

import pytest

from pipeline.runs.stages import BY_NAME, COUPLED
from softfinger.study.table import origin
from tests.conftest import CASES, ROOT

TABLES = [*(ROOT / "docs").rglob("*.csv"), *(ROOT / "cases").glob("*/studies/results/*.csv")]
# of before the tables stated their stages; `make evidence` was not run since
OLDER = {"docs/stability/runs.csv", "docs/stability/images.csv"}


def head_of(path):
    """The first line of a table that states what it was made from; {} of another."""
    with path.open(encoding="utf-8") as file:
        first = file.readline()
    return json.loads(first[1:]) if first.startswith("# {") else {}


def test_tables_state_the_stages_of_this_code():
    """Where one fails, make it anew: the head of each table says which stages it used."""
    code = {name: stage.version for name, stage in BY_NAME.items()}
    code |= {f"{name}_coupled": stage.version for name, stage in COUPLED.items()}
    heads = {str(path.relative_to(ROOT)): head_of(path) for path in TABLES}
    made = {path: head for path, head in heads.items() if head and path not in OLDER}
    assert made
    for path, head in made.items():
        assert head["commit"], path
        assert head["stages"] == {name: code[name] for name in head["stages"]}, path


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
