"""Tables as laboratories save them: what is unambiguous is read, the rest is one sentence."""

import codecs
import os
from pathlib import Path

import numpy as np
import pytest

from pipeline.kinematics.pressure_law import measured_law
from pipeline.scene.scene import load_scene
from piv.files.errors import StageError
from piv.files.regular import read_regular
from piv.formats.user_tables import read_columns, read_history
from softfinger.study.rows import read_study
from tests.conftest import write_scene

TIMES, PRESSURES = [0.0, 0.04, 0.08, 0.5], [0.0, 1234.5, 10000.0, 20500.0]
POINT = ["0,0", "0.04,1234.5", "0.08,10000", "0.5,20500"]
COMMA = ["0;0", "0,04;1234,5", "0,08;10000", "0,5;20500"]


def joined(*rows: str) -> bytes:
    return "\n".join(rows).encode() + b"\n"


@pytest.mark.parametrize(
    "content",
    [
        joined("t,p", *POINT), joined(*POINT), joined("# of a sensor", "t , p", "", *POINT),
        codecs.BOM_UTF8 + joined("t,p", *POINT),
        ("\ufeff" + joined("t\tp", *POINT).decode().replace(",", "\t")).encode("utf-16-le"),
        joined("t,p", *POINT).replace(b"\n", b"\r\n"), joined("t,p  # s, Pa", *POINT),
        joined("t;p", *POINT).replace(b",", b";"), joined("t\tp", *COMMA).replace(b";", b"\t"),
        joined("sep=;", "t;p", *COMMA), joined("Time [s];Pressure [Pa]", *COMMA),
        joined('"t","p"', '"0","0"', '"0.04","1,234.5"', '"0.08","10,000"', '"0.5","20,500"'),
        joined("t;p", "0;0", "0,04;1.234,5", "0,08;10.000", "0,5;20.500"),
        joined("t,p", "0,0", "0.04,1'234.5", "0.08,10'000", "0.5,20 500"),
        joined("t [ms],p [kPa]", "0,0", "40,1.2345", "80,10", "500,20.5"),
        joined("t_ms;p_mbar", "0;0", "40;12,345", "80;100,0", "500;205,0"),
    ],
)  # fmt: skip
def test_a_table_of_a_laboratory_is_read(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "p.csv").write_bytes(content)
    times, pressures = read_history(tmp_path / "p.csv", "pressure", 2)
    np.testing.assert_allclose(times, TIMES, rtol=1e-12)
    np.testing.assert_allclose(pressures, PRESSURES, rtol=1e-12)


@pytest.mark.parametrize(
    "kind, column, factor",
    [("place", "x [cm]", 1e-2), ("place", "x [mm]", 1e-3), ("speed", "u [mm/s]", 1e-3),
     ("pressure", "p [hPa]", 100), ("pressure", "p [bar]", 1e5)],
)  # fmt: skip
def test_units_of_a_header_are_those_of_the_values(tmp_path, kind, column, factor) -> None:
    (tmp_path / "a.csv").write_text(f"t,{column}\n0,0\n1,2\n")
    assert read_history(tmp_path / "a.csv", kind, 2)[1] == pytest.approx([0, 2 * factor])


@pytest.mark.parametrize(
    "content, words",
    [
        (joined("t;p", "0;0", "1;10,000"), "the comma of '10,000' may be a decimal comma or sep"),
        (joined("t;p", "0,5;0", "1;10.5"), "may be a decimal comma"),
        (joined("t,p", "0,0", "0,04,1234,5"), "line 3: .* has 4 cells, .* need semicolons"),
        (joined("t,p"), "has 0 rows of 2 numbers"), (b"", "has 0 rows of 2 numbers"),
        (joined("t,p", "0,0", "", "0.1,oops"), "line 4, column p: 'oops' is not a finite number"),
        (joined("t,p", "0,0", "0.1,"), "line 3, column p: '' is not a finite number"),
        (joined("t,p", "0,0", '0.1,"1'), "line 3: unexpected end of data"),
        (joined("t,p", "0,0", "0.1,1e999"), "'1e999' is not a finite number"),
        (joined("t,p", "0,0", "0.1,5", "0.1,6"), "times must increase; line 4 does not"),
        (joined("Zeit;Druck", "0;0", "1;2"), "first line is 'Zeit,Druck'; name the columns t,p"),
        ("t,p\n0,0\n1,2 µ".encode("latin-1"), "is not UTF-8 text"),
    ],
)  # fmt: skip
def test_any_other_table_is_one_sentence_with_its_place(
    tmp_path: Path, content: bytes, words: str
) -> None:
    (tmp_path / "p.csv").write_bytes(content)
    with pytest.raises(StageError, match=words):
        read_history(tmp_path / "p.csv", "pressure", 2)


def test_what_is_no_regular_file_of_the_stated_size_is_not_read(tmp_path: Path) -> None:
    """A device gave 8 GB in half a minute; a pipe never ends."""
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "zero").symlink_to("/dev/zero")
    for name in ("pipe", "zero"):
        with pytest.raises(StageError, match=f"{name}: is not a regular file"):
            read_history(tmp_path / name, "pressure", 2)
    with (tmp_path / "large").open("wb") as file:
        file.truncate(2**27)
    with pytest.raises(StageError, match="large: has 134 MB; at most 67 MB are read"):
        read_regular(tmp_path / "large")


def test_columns_by_name_and_cells_of_text(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_bytes(codecs.BOM_UTF8 + b"x;name;y\n0,5;a,b;7\n")
    table = read_columns(tmp_path / "a.csv", ["x", "name"], None)
    assert table.numbers(["x", "y"]).tolist() == [[0.5, 7.0]]
    assert table.text("name") == ["a,b"]
    with pytest.raises(StageError, match="unknown column y; the columns are x, name"):
        read_columns(tmp_path / "a.csv", ["x", "name"])


def test_a_study_of_a_spreadsheet_is_read(tmp_path: Path) -> None:
    text = 'run;level;mesh.tip_cell;camera.centre\na;tiny;0,002;"[0.1, 0.2]"\nb;tiny;0,0015;\n'
    (tmp_path / "s.csv").write_bytes(codecs.BOM_UTF8 + text.encode())
    first, second = read_study(tmp_path / "s.csv")
    assert first.overrides == {"mesh.tip_cell": 0.002, "camera.centre": [0.1, 0.2]}
    assert second.overrides == {"mesh.tip_cell": 0.0015}


def test_a_scene_with_a_bom_is_read_and_one_without_end_is_not(tmp_path: Path) -> None:
    scene = write_scene(tmp_path / "scene")
    path = scene.folder / "scene.toml"
    text = path.read_bytes()
    path.write_bytes(codecs.BOM_UTF8 + text)
    assert load_scene(scene.folder, "tiny").tank == scene.tank
    for more, words in (
        (b"\n[fluid]\ndensity = " + b"9" * 4400, "not valid TOML: .*digits$"),
        (b"\n[" + b".".join([b"a"] * 3000) + b"]", "lie more than 32 deep"),
        (b"\nx = " + b"[" * 3000 + b"]" * 3000, "not valid TOML|more than 32 deep"),
        (b"\n#" + b"x" * 2**21, "has 2 MB; at most 1 MB are read"),
    ):
        path.write_bytes(text + more)
        with pytest.raises(StageError, match=words):
            load_scene(scene.folder, "tiny")


LATE, MILLISECONDS = "5,0\n5.5,20000\n", "".join(f"{k},{99 * k}\n" for k in range(99))


@pytest.mark.parametrize("rows", [LATE, MILLISECONDS])
def test_a_history_that_the_run_does_not_reach_is_refused(tmp_path: Path, rows: str) -> None:
    """The first begins after the run; the second is in ms."""
    (tmp_path / "p.csv").write_text(f"t,p\n{rows}")
    with pytest.raises(StageError, match=r"rows lie before motion.end_time = 0.5 s.*t \[ms\]"):
        measured_law(tmp_path / "p.csv", 0.04, 0.5)
    measured_law(tmp_path / "p.csv", 0.04, 60.0)
