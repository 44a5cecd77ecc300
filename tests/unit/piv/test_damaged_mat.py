"""Damaged MAT 5 files are refused, also those that end the process in which scipy reads them."""

import struct

import numpy as np
import pytest
from scipy.io import savemat

from piv.foreign.pivlab import instants
from piv.foreign.read import read_vectors
from tests.pivlab_session import write_mat5

DOUBLE, CELL = 6, 1  # classes


def element(kind, content):
    return struct.pack("<II", kind, len(content)) + content + bytes(-len(content) % 8)


def matrix(content, *, name=b"", kind=DOUBLE, shape=(2, 3), flags=0):
    head = element(6, struct.pack("<II", kind | flags, 0))
    head += element(5, struct.pack(f"<{len(shape)}i", *shape))
    return element(14, head + element(1, name) + content)


def numbers(data=9, count=6):
    return element(data, struct.pack(f"<{count}d", *range(count)))


@pytest.fixture
def put(tmp_path):
    """Write a session whose variables are sound but for those given by name."""

    def write(**variables):
        path = tmp_path / "a.mat"
        names = ("x", "y", "u_original", "v_original", "typevector_original")
        sound = {n: matrix(numbers(), name=n.encode()) for n in names}
        head = b"MATLAB 5.0 MAT-file".ljust(124) + b"\x00\x01IM"
        path.write_bytes(head + b"".join((sound | variables).values()))
        return path

    return write


def test_a_sound_session_is_read(put):
    cell = matrix(matrix(numbers()), name=b"x", kind=CELL, shape=(1, 1))
    for x in (matrix(numbers(), name=b"x"), cell):
        ((vectors, stated),) = instants(put(x=x))
        assert vectors[0].tolist() == [[0, 2, 4], [1, 3, 5]]
        assert stated == {}


@pytest.mark.parametrize("data", [0, 8, 10, 11, 14, 15, 19, 20])
@pytest.mark.parametrize("inside", [False, True], ids=["plain", "in a cell"])
def test_a_data_type_that_does_not_exist(put, data, inside):
    """scipy takes it as an index into a table of twenty pointers: a segmentation fault.

    Far beyond the table chance decides what it finds there, so that no test can.
    """
    bad = matrix(numbers(data), name=b"" if inside else b"x")
    path = put(x=matrix(bad, name=b"x", kind=CELL, shape=(1, 1)) if inside else bad)
    for read in (instants, lambda p: read_vectors([p])):
        with pytest.raises(ValueError, match=r"a\.mat: damaged"):
            read(path)


def test_cells_in_cells(put):
    """scipy follows them until the stack ends: a segmentation fault from about 5000 on."""
    for depth in (2, 20000):
        inner = matrix(numbers())
        for _ in range(depth - 1):
            inner = matrix(inner, kind=CELL, shape=(1, 1))
        with pytest.raises(ValueError, match=r"a\.mat: damaged"):
            instants(put(x=matrix(inner, name=b"x", kind=CELL, shape=(1, 1))))


@pytest.mark.parametrize("compressed", [False, True])
def test_wherever_it_is_cut_off(tmp_path, compressed):
    path = write_mat5(tmp_path / "a.mat", 1, compressed)
    whole = path.read_bytes()
    for length in range(0, len(whole), 29):
        path.write_bytes(whole[:length])
        with pytest.raises(ValueError, match=r"a\.mat: "):
            read_vectors([path])


def test_mat_4_is_refused(tmp_path):
    savemat(tmp_path / "a.mat", {"x": np.eye(2)}, format="4")
    with pytest.raises(ValueError, match=r"a\.mat: .*MAT 4 is not read; save it with -v7"):
        read_vectors([tmp_path / "a.mat"])
