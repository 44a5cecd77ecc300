"""Drawn runs and their finer ones, and what counts as wrong without a warning."""

import numpy as np
import pandas as pd
import pytest

from docs.evidence.stability import drawn
from pipeline.formats.records import FORCES
from pipeline.solve import guards
from softfinger.study.rows import read_study
from tests.conftest import ROOT


def test_each_drawn_run_has_one_at_half_the_step_and_finer_cells():
    rows = read_study(ROOT / drawn.TABLE)
    assert [row.level for row in rows].count("smoke") == 80
    assert [row.level for row in rows].count("draft") == 24
    for run, fine in zip(rows[::2], rows[1::2], strict=True):
        assert fine.run == f"{run.run}_fine"
        step, cell = "numerics.time_step", "mesh.wall_cell"
        assert fine.overrides[step] == pytest.approx(run.overrides[step] / 2)
        assert fine.overrides[cell] == pytest.approx(run.overrides[cell] / 1.5, rel=1e-3)
        assert fine.overrides["motion.strokes"] == run.overrides["motion.strokes"]


@pytest.mark.parametrize(
    "factor, warning, ended",
    [(1.1, "", "completed"), (1.3, "", "UNWARNED"), (1.3, "lower the step", "wrong")],
)
def test_a_run_is_wrong_where_its_force_differs_by_a_fifth_unwarned(
    tmp_path, monkeypatch, factor, warning, ended
):
    time = np.arange(41) * 0.01
    runs = []
    for name, size in (("a", factor), ("a_fine", 1.0)):
        folder = tmp_path / name / "run"
        folder.mkdir(parents=True)
        force = size * np.sin(np.pi * time / 0.4)
        columns = {"time": time, "fx": force, "fy": 0 * force}
        none = np.zeros(len(time))
        FORCES.write(
            folder / "forces.csv",
            np.column_stack([columns.get(name, none) for name in FORCES.columns]),
        )
        runs.append({"run": name, "out": str(tmp_path / name), "overrides": {}})
    balance = {"warning": warning, "unexplained_share": 0.01}
    monkeypatch.setattr(drawn.solver, "result", lambda run: {"ended": "completed"})
    monkeypatch.setattr(
        drawn, "RUN", type("", (), {"read": lambda path: {"power_balance": balance}})
    )
    found = drawn.result(*runs)
    assert found["ended"] == ended
    assert found["error_peak"] == pytest.approx(factor - 1)
    assert found["error_impulse"] == pytest.approx(factor - 1)


@pytest.mark.parametrize(
    "faults, warning, ended",
    [([], "power", "completed"), ([drawn.solver.ENERGY], "power", "wrong"),
     ([drawn.solver.ENERGY], "", "WRONG"), ([drawn.solver.ENERGY, "no force"], "power", "WRONG")],
)  # fmt: skip
def test_a_warning_covers_energy_from_nothing_alone(faults, warning, ended):
    assert drawn.solver.ending(faults, warning) == ended


def test_the_warning_of_the_time_step_is_as_drawn_runs_set_it():
    found = drawn.calibrated(pd.read_csv(ROOT / "docs" / "stability" / "drawn.csv", comment="#"))
    # the factor states an error that nine runs of ten do not exceed, to a fifth
    assert pytest.approx(found["factor"], rel=0.2) == guards._ERROR_OF_CHANGE
    # half of the error at which a wrong run would be missed: 1.4 times in the change of the force
    assert 0.5 * found["limit"] >= guards._WRONG
    assert found["unwarned"] < drawn.WRONG


def test_rows_of_pairs_that_are_not_made_anew_stay_where_their_stages_are_the_same(tmp_path):
    path = tmp_path / "drawn.csv"
    path.write_text('# {"stages": {"solve": 1}}\nrun,error_peak\na,0.1\nb,0.2\n')
    new = pd.DataFrame({"run": ["b", "c"], "error_peak": [0.3, 0.4]}, dtype=object)
    kept = drawn.with_earlier(new, {"solve": 1}, path)
    assert kept.astype(str).to_numpy().tolist() == [["b", "0.3"], ["c", "0.4"], ["a", "0.1"]]
    assert drawn.with_earlier(new, {"solve": 2}, path)["run"].tolist() == ["b", "c"]
