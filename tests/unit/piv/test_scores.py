"""The tables of docs/piv_benchmarks.md: what errors are taken over, and what is told of vectors."""

import os
import stat
import subprocess

import numpy as np
import pytest
import xarray as xr

from tests.studies.piv import with_peers
from tests.studies.piv.particles import render
from tests.studies.piv.scores import inner, joined, judged, rms_of, told

SHAPE = (104, 136)


def still(x, y):
    return 0 * x, 0 * y


def vectors(u, step=8, **more):
    """Vectors at every `step` px with u (a number or (ny, nx)) and v = 0."""
    y, x = np.arange(step, SHAPE[0], step), np.arange(step, SHAPE[1], step)
    u = np.broadcast_to(u, (y.size, x.size)).astype(float)
    fields = {"u": u, "v": np.where(np.isfinite(u), 0.0, np.nan)} | more
    return xr.Dataset({n: (("y", "x"), f) for n, f in fields.items()}, {"x": x, "y": y})


def test_errors_are_of_the_vectors_that_every_method_gives():
    gone = vectors(0.1)["u"].values.copy()
    gone[:, gone.shape[1] // 2 :] = np.nan
    ours = vectors(gone)
    peer = vectors(0.2, step=4)
    peer["u"][:, peer.sizes["x"] // 2 + 2 :] = 9.0  # where ours leaves vectors out
    both = (ours, peer)
    assert rms_of([judged(peer, still, inner(SHAPE))]) > 3
    assert rms_of([judged(peer, still, inner(SHAPE), both)]) == pytest.approx(0.2 / np.sqrt(2))
    assert rms_of([judged(ours, still, inner(SHAPE), both)]) == pytest.approx(0.1 / np.sqrt(2))


def test_uncertain_vectors_are_told_and_not_counted_as_unflagged():
    u = vectors(0.0)["u"].values.copy()
    u[6, 6:8] = 2.0  # both wrong, one of them flagged
    u[6, 9] = np.nan
    flag = np.zeros(u.shape, "uint8")
    flag[6, 6] = 5
    std = np.full(u.shape, 0.1)
    parts = [judged(vectors(u, flag=flag, u_std=std, v_std=std), still, inner(SHAPE))]
    n = joined(parts).flag.size
    cover, uncertain, far, gone = (float(c.strip(" %|")) for c in told(parts).split("|")[:4])
    assert cover == round(100 * (1 - 1 / (n - 1)))
    assert uncertain == pytest.approx(100 / (n - 1), abs=0.01)
    assert far == pytest.approx(100 / (n - 2), abs=0.001)
    assert gone == pytest.approx(100 / n, abs=0.01)


def peer(folder, text):
    """A stand-in for the peers' interpreter; $2 is the folder of the pairs."""
    script = folder / "python"
    script.write_text(f"#!/bin/sh\n{text}\n")
    script.chmod(script.stat().st_mode | stat.S_IXUSR)
    return script


def test_with_peers_gives_our_vectors_beside_theirs(tmp_path, monkeypatch):
    a, b = render(lambda x, y: (1 + 0 * x, 0 * x), shape=SHAPE, noise=0.01)
    u = vectors(1.1)
    found = {"0_t": 2.0, "0_name": "Other 16"} | {f"0_{n}": u[n].values for n in "xyuv"}
    np.savez(tmp_path / "found.npz", **found)
    script = peer(tmp_path, f'cp {tmp_path}/found.npz "$2/one.peers.npz"')
    monkeypatch.setattr(with_peers, "peer_python", lambda: script)
    rows = {"row": (lambda x, y: (1 + 0 * x, 0 * x), inner(SHAPE))}
    results = with_peers.compared(None, [with_peers.Pair("one", (a, b), rows)])
    assert list(results) == [with_peers.OURS, "Other 16"]
    assert rms_of(results[with_peers.OURS]["row"]) < 0.05
    assert rms_of(results["Other 16"]["row"]) == pytest.approx(0.1 / np.sqrt(2))
    assert results["Other 16"]["row"][0].seconds == 2.0


def test_what_a_peer_fails_at_is_seen(tmp_path, monkeypatch, capfd):
    a, b = render(still, shape=SHAPE)
    monkeypatch.setattr(
        with_peers, "peer_python", lambda: peer(tmp_path, "echo no module yaml >&2; exit 1")
    )
    pair = with_peers.Pair("one", (a, b), {"row": (still, inner(SHAPE))})
    with pytest.raises(subprocess.CalledProcessError):
        with_peers.compared(tmp_path / "kept", [pair])
    assert "no module yaml" in capfd.readouterr().err
    assert os.listdir(tmp_path / "kept") == ["one.pair.npz"]
