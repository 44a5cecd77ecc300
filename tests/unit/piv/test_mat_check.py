"""Damaged MAT 5 files are refused before scipy's compiled reader, which some of them end, sees them."""

import io
import struct

import numpy as np
import pytest
from scipy.io import loadmat, savemat

from piv.foreign.mat_check import DEEPEST, check_mat
from piv.foreign.pivlab import instants
from piv.foreign.read import read_vectors

DOUBLE, CELL, CHAR, STRUCT = 6, 1, 4, 2  # classes


def element(kind, content):
    return struct.pack("<II", kind, len(content)) + content + bytes(-len(content) % 8)


def matrix(content, *, name=b"", kind=DOUBLE, shape=(2, 3), flags=0):
    head = element(6, struct.pack("<II", kind | flags, 0)) + element(
        5, struct.pack(f"<{len(shape)}i", *shape)
    )
    return element(14, head + element(1, name) + content)


def numbers(data=9, count=6):
    return element(data, struct.pack(f"<{count}d", *range(count)))


@pytest.fixture
def put(tmp_path):
    def write(*variables):
        path = tmp_path / "a.mat"
        path.write_bytes(b"MATLAB 5.0 MAT-file".ljust(124) + b"\x00\x01IM" + b"".join(variables))
        return path

    return write


def test_what_is_built_here_is_what_scipy_reads(put):
    path = put(matrix(numbers(), name=b"x"), matrix(matrix(numbers()), name=b"u", kind=CELL, shape=(1, 1)))
    assert check_mat(path, ["x", "u", "absent"]) == ["x", "u"]
    found = loadmat(path)
    assert found["x"].tolist() == found["u"][0, 0].tolist() == [[0, 2, 4], [1, 3, 5]]


@pytest.mark.parametrize("data", [0, 8, 10, 11, 14, 15, 19, 20, 1000, 65535])
@pytest.mark.parametrize("inside", [False, True], ids=["plain", "in a cell"])
def test_a_data_type_that_does_not_exist(put, data, inside):
    """scipy takes it as an index into a table of twenty pointers, some of them empty: a segmentation fault."""
    bad = matrix(numbers(data), name=b"" if inside else b"x")
    path = put(matrix(bad, name=b"x", kind=CELL, shape=(1, 1)) if inside else bad)
    for read in (lambda p: list(instants(p)), lambda p: read_vectors([p])):
        with pytest.raises(
            ValueError, match=rf"a\.mat: damaged.*'x': .*data type {data}, which does not exist"
        ):
            read(path)


def test_text_of_a_data_type_that_does_not_exist(put):
    text = matrix(element(40, b"[px] "), name=b"units", kind=CHAR, shape=(1, 5))
    path = put(matrix(numbers(), name=b"x"), text)
    with pytest.raises(ValueError, match="'units': characters of the data type 40"):
        read_vectors([path])
    assert check_mat(path, ["x"]) == ["x"]  # what is not read may be anything


def test_cells_in_cells(put):
    """scipy follows them until the stack ends: a segmentation fault from about 5000 on."""

    def nested(depth):
        inner = matrix(numbers())
        for _ in range(depth - 1):
            inner = matrix(inner, kind=CELL, shape=(1, 1))
        return matrix(inner, name=b"x", kind=CELL, shape=(1, 1))

    assert check_mat(put(nested(DEEPEST)), ["x"]) == ["x"]
    with pytest.raises(ValueError, match="cells in cells, more than 8 deep"):
        check_mat(put(nested(DEEPEST + 1)), ["x"])


CELLS = {"name": b"x", "kind": CELL, "shape": (1, 1)}


@pytest.mark.parametrize(
    "variable, says",
    [
        (matrix(numbers(), name=b"x", shape=(2, 4)), "48 bytes of data type 9 do not make 2 x 4 numbers"),
        (matrix(numbers(), name=b"x", shape=(-2, -3)), "dimensions -2 x -3"),
        (matrix(numbers(), name=b"x", flags=0x800), "complex numbers"),
        (matrix(numbers() + bytes(8), name=b"x"), "more in it than its dimensions"),
        (matrix(numbers(), name=b"x", kind=STRUCT), "an array of the class 2"),
        (matrix(numbers(), name=b"x", kind=0), "an array of the class 0"),
        (matrix(matrix(numbers()), **CELLS | {"shape": (2**20, 2**10)}), "do not make 1048576 x 1024 cells"),
        (matrix(matrix(numbers()) * 2, **CELLS), "more in it than its dimensions"),
        (matrix(numbers(), **CELLS), "data of the type 9 where a cell's matrix belongs"),
        (matrix(matrix(numbers() + bytes(8)), **CELLS), "a cell is longer than its dimensions say"),
        (matrix(b"", name=b"x", kind=CHAR, shape=(2**20, 2**10)), "it ends within an element"),
        (matrix(element(16, b""), name=b"x", kind=CHAR, shape=(2**20, 2**10)), "0 bytes do not make"),
        (matrix(numbers(), name=b"x")[:-9], "an element of 104 bytes where 95 are left"),
        (matrix(numbers(), name=b"x") + b"\x0e", "it ends within an element"),
        (element(14, b""), "type 14 and 0 bytes where a variable belongs"),
        (matrix(numbers()[:4] + struct.pack("<I", 56) + numbers()[8:], name=b"x"), "an element of 56 bytes"),
    ],
)
def test_what_does_not_fit_together(put, variable, says):
    with pytest.raises(ValueError, match=r"a\.mat: damaged") as error:
        check_mat(put(variable), ["x"])
    assert says in str(error.value)
    assert "\n" not in str(error.value)


def export(frames, compressed):
    """A PIVlab session as scipy writes it."""
    x, y = np.meshgrid([8.0, 16.0, 24.0], [8.0, 16.0])
    made = {
        "x": x,
        "y": y,
        "u_original": 0.1 * x,
        "v_original": 0.2 * y,
        "typevector_original": np.ones((2, 3)),
    }
    cells = {name: np.empty((frames, 1), object) for name in (*made, "u_filtered")}
    for name, cell in cells.items():
        for k in range(frames):
            cell[k, 0] = made.get(name, np.empty((0, 0)))  # PIVlab's [] where nothing was filtered
    other = {"settings": {"window": 32.0}, "empty": "", "units": "[px] respectively [px/frame]"}
    into = io.BytesIO()
    savemat(into, other | cells, do_compression=compressed)
    return into.getvalue()


@pytest.mark.parametrize("compressed", [False, True])
def test_a_session_is_read(tmp_path, compressed):
    path = tmp_path / "a.mat"
    path.write_bytes(export(3, compressed))
    assert check_mat(path, ["x", "units", "empty", "none"]) == ["empty", "units", "x"]
    told = {"scale_m_per_px": 1e-3, "interval_s": 0.5, "image_rows": 32, "frame_rate_hz": 2.0}
    plane = read_vectors([path], **told)
    assert dict(plane.sizes) == {"time": 3, "y": 2, "x": 3}
    assert plane["u"].values[2, 0, 0] == pytest.approx(0.8e-3 / 0.5)


@pytest.mark.parametrize("compressed", [False, True])
def test_wherever_it_is_cut_off(tmp_path, compressed):
    path, whole = tmp_path / "a.mat", export(1, compressed)
    for length in range(0, len(whole), 7):
        path.write_bytes(whole[:length])
        with pytest.raises(ValueError, match=r"a\.mat: "):
            read_vectors([path])


def test_mat_4_is_refused(tmp_path):
    savemat(tmp_path / "a.mat", {"x": np.eye(2)}, format="4")
    with pytest.raises(ValueError, match=r"a\.mat: not a MAT 5 file \(MAT 4 is not read\); save it with -v7"):
        read_vectors([tmp_path / "a.mat"])
