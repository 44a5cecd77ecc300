"""Vector buffers of DaVis through lvpyio, in a process of its own: damaged files end the library's process by abort()."""

from __future__ import annotations

import atexit
import os
import pickle
import struct
import subprocess
import sys
from pathlib import Path
from typing import Any

from fileio.errors import one_line

_worker: subprocess.Popen[bytes] | None = None


def read_buffer(path: Path, plane: int = 0) -> dict[str, Any]:
    """Vectors of the first frame of a .vc7: `u`, `v` (rows, columns), `absent` (bool), `grid` (x, y), and of the
    axes `x`, `y`, `i` each (slope, offset, unit).

    ValueError where the library cannot read it. The process stays for further files: loading the library takes a second.
    """
    global _worker
    if _worker is None or _worker.poll() is not None:
        _worker = subprocess.Popen(
            [
                sys.executable,
                "-c",
                f"import sys; sys.path[:0] = {sys.path!r}; import piv.foreign.davis; piv.foreign.davis.serve()",
            ],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
        )
        atexit.register(_stop, _worker)
    assert _worker.stdin is not None
    assert _worker.stdout is not None
    try:
        _send(_worker.stdin, (str(path.resolve()), plane))
        found = _receive(_worker.stdout)
    except (OSError, EOFError):
        _stop(_worker)
        raise ValueError("the DaVis library gave up on it; the file is damaged or another format") from None
    if isinstance(found, str):
        raise ValueError(found)
    return found


def serve() -> None:
    """The process' loop: paths in, buffers or error texts out, until the other side closes."""
    # the library's own talk, also that of its C++ part, must not get between the answers
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    import lvpyio

    while True:
        try:
            path, plane = _receive(sys.stdin.buffer)
        except EOFError:
            return
        try:
            frame = lvpyio.read_buffer(path)[0]
            values = frame.as_masked_array(plane)
            if values.dtype.names is None or "u" not in values.dtype.names:
                raise ValueError("the DaVis buffer holds an image, not vectors")
            scales = {a: getattr(frame.scales, a) for a in ("x", "y", "i")}
            found: Any = {
                "u": values["u"].data,
                "v": values["v"].data,
                "absent": _absent(values),
                "grid": (frame.grid.x, frame.grid.y),
                **{a: (float(s.slope), float(s.offset), str(s.unit)) for a, s in scales.items()},
            }
        except Exception as error:  # the library raises its own kinds
            found = one_line(error)
        _send(answers, found)


def _absent(values: Any) -> Any:
    import numpy as np

    return np.ma.getmaskarray(values)["u"]


def _send(stream: Any, value: Any) -> None:
    content = pickle.dumps(value)
    stream.write(struct.pack("<Q", len(content)) + content)
    stream.flush()


def _receive(stream: Any) -> Any:
    head = stream.read(8)
    if len(head) < 8:
        raise EOFError
    size = struct.unpack("<Q", head)[0]
    content = stream.read(size)
    if len(content) < size:
        raise EOFError
    return pickle.loads(content)


def _stop(worker: subprocess.Popen[bytes]) -> None:
    worker.kill()
    worker.wait()
