"""A file whose values lie in another file is refused: nothing but the named files is read."""

import h5py
import numpy as np
import pytest

from piv.foreign.pivlab import instants
from piv.formats.plane_series import make_plane, write_plane
from piv.formats.recording import RecordingWriter
from piv.sequence.chunks import join
from piv.view.session import open_session
from postprocess.lab.dpiv_toml import seen_in
from tests.piv_command import piv

SHAPE = (4, 96, 96)


def move_out(path, name, kind):
    """Put the values of a variable into another file, in one of HDF5's three ways."""
    secret = path.with_name("secret")
    with h5py.File(path, "r+") as file:
        values = file[name][...]
        attributes, del_ = dict(file[name].attrs), file.__delitem__
        del_(name)
        if kind == "link":
            with h5py.File(secret, "w") as other:
                other[name] = values
            file[name] = h5py.ExternalLink(secret.name, f"/{name}")
            return
        if kind == "virtual":
            with h5py.File(secret, "w") as other:
                other[name] = values
            layout = h5py.VirtualLayout(values.shape, values.dtype)
            layout[...] = h5py.VirtualSource(secret.name, name, values.shape)
            file.create_virtual_dataset(name, layout)
        else:
            secret.write_bytes(values.tobytes())
            place = [(str(secret), 0, h5py.h5f.UNLIMITED)]
            file.create_dataset(name, values.shape, values.dtype, external=place)
        for key in attributes.keys() - {"DIMENSION_LIST", "REFERENCE_LIST"}:
            file[name].attrs[key] = attributes[key]


def recording(path):
    with RecordingWriter(path, SHAPE[1:], np.uint8, 4, {"frame_rate_hz": 100.0}) as writer:
        for k in range(4):
            writer.write(k, np.random.default_rng(k).integers(0, 255, SHAPE[1:], np.uint8))
        writer.finish()


def plane(path):
    u = np.ones((2, 8, 8))
    write_plane(make_plane(np.arange(8.0), np.arange(8.0), u, u, time=np.arange(2.0)), path)


def session(path):
    with h5py.File(path, "w") as file:
        for name in ("x", "y", "u_original", "v_original", "typevector_original"):
            file[name] = np.ones((3, 3))


READERS = [
    ("images.h5", recording, "frames", lambda p: piv("correlate", p, "-o", p.with_name("o.h5"))),
    ("images.h5", recording, "frames", lambda p: open_session([str(p)])),
    ("images.h5", recording, "time", lambda p: seen_in(p.parent)),
    ("piv.h5", plane, "u", lambda p: piv("stats", p, "-o", p.with_name("o.h5"))),
    ("piv.h5", plane, "valid", lambda p: piv("convert", p, "-o", p.with_name("o.csv"))),
    ("piv.h5", plane, "u", lambda p: join([p], p.with_name("o.h5"))),
    ("a.mat", session, "u_original", instants),
]


@pytest.mark.parametrize("kind", ["link", "virtual", "external"])
@pytest.mark.parametrize("name, write, variable, read", READERS)
def test_values_in_another_file_are_refused(tmp_path, capsys, name, write, variable, read, kind):
    path = tmp_path / name
    write(path)
    move_out(path, variable, kind)
    try:
        read(path)
        message = capsys.readouterr().err
    except ValueError as error:
        message = str(error)
    assert f"{path}: {variable} lies in another file" in message
    assert not (tmp_path / "o.h5").exists()
