"""The export script against a stand-in for Abaqus' own modules: its CSV is what the importer reads."""

import runpy
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace

import numpy as np

from pipeline.fea.imported.abaqus import read_abaqus

SCRIPT = Path(__file__).parents[3] / "docs" / "abaqus_export.py"
MODEL = """*Part, name=Bar
*Node
1, 0., 0., 0.
2, 70., 0., 0.
*End Part
*Assembly, name=A
*Instance, name=Bar-1, part=Bar
1., 2., 3.
*End Instance
*End Assembly
"""


def frame(share, double):
    def value(node):
        u = np.array([share, 2 * share * node, 0.0])
        instance = SimpleNamespace(name="BAR-1")
        data = {"dataDouble": u, "data": None} if double else {"data": u.astype(np.float32)}
        return SimpleNamespace(
            instance=instance, nodeLabel=node, precision="double" if double else "single", **data
        )

    return SimpleNamespace(
        frameValue=2 * share, fieldOutputs={"U": SimpleNamespace(values=[value(1), value(2)])}
    )


def test_frames_become_states(tmp_path, monkeypatch):
    step = SimpleNamespace(
        timePeriod=2.0, frames=[frame(0.0, False), frame(0.5, True), frame(1.0, True)]
    )
    odb = SimpleNamespace(steps={"Inflate": step}, close=lambda: None)
    access, constants = ModuleType("odbAccess"), ModuleType("abaqusConstants")
    access.openOdb = lambda path, readOnly: odb
    constants.DOUBLE_PRECISION = "double"
    monkeypatch.setitem(sys.modules, "odbAccess", access)
    monkeypatch.setitem(sys.modules, "abaqusConstants", constants)
    monkeypatch.setattr(
        sys, "argv", ["script", "job.odb", "Inflate", "-30", str(tmp_path / "u.csv")]
    )
    runpy.run_path(str(SCRIPT), run_name="__main__")

    (tmp_path / "bar.inp").write_text(MODEL)
    fields = read_abaqus(tmp_path / "bar.inp", tmp_path / "u.csv")
    np.testing.assert_allclose(fields.progress, [-30, -15, 0])
    np.testing.assert_allclose(fields.points, [[1, 2, 3], [71, 2, 3]])
    np.testing.assert_allclose(fields.displacements[0], [[1, 2, 0], [1, 4, 0]])
    np.testing.assert_allclose(fields.displacements[2], 0)
