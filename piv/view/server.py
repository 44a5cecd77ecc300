"""The page, served to the browsers of this machine alone, whose address holds a secret."""

import json
import secrets
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib.resources import files
from pathlib import Path
from typing import Any
from urllib.parse import parse_qsl, urlsplit

from piv.files.errors import one_line, sentence
from piv.files.json_text import plain
from piv.view import answers
from piv.view.regions import write_regions
from piv.view.session import Session

LONGEST = 2**24  # bytes of a request
_SHOWN = 60.0  # s until the file that names the address to the browser is removed


class _Answers:
    """What each name in the page's address gives: bytes, or what becomes JSON."""

    def __init__(self, session: Session, output: Path) -> None:
        self.session, self.output = session, output
        self.tried: Any = None  # vectors of other settings, shown in place of those of the file

    def about(self) -> Any:
        """Describe the session to the page."""
        return answers.about(self.session, str(self.output))

    def image(self, step: int, second: int, low: float, high: float) -> bytes:
        """Return a frame as PNG."""
        return self.session.image(step, second == 1, low, high)

    def field(self, step: int) -> Any:
        """Return the vectors of a step."""
        self.tried = None
        return answers.field(self.session.plane(step))

    def attempt(self, step: int, settings: dict[str, Any], polygons: list) -> Any:
        """The vectors of a step with other settings; measures are of them until the next step."""
        self.tried = answers.tried(self.session, step, settings, polygons)
        return answers.field(self.tried) | answers.proposal(self.session, settings)

    def _shown(self, step: int) -> Any:
        return self.tried if self.tried is not None else self.session.plane(step)

    def vortices(self, step: int) -> Any:
        """Return the vortices of the vectors that are shown."""
        return answers.vortices(self._shown(step))

    def inside(self, step: int, polygon: list) -> Any:
        """Return circulation and means over an area."""
        return answers.inside(self._shown(step), polygon)

    def profile(self, step: int, line: list) -> Any:
        """Return the velocities along a line."""
        return answers.profile(self._shown(step), line)

    def save(self, kept: dict[str, list], roi: list[float] | None) -> Any:
        """Write the masks of each frame and the region."""
        polygons = {
            int(frame): [[[float(x), float(y)] for x, y in shape] for shape in shapes]
            for frame, shapes in kept.items()
        }
        x0, y0, x1, y1 = map(float, roi or (0, 0, 0, 0))
        region = None if roi is None else (x0, y0, x1, y1)
        return {"text": write_regions(self.output, self.session.unit, polygons or {0: []}, region)}


def serve(
    session: Session, output: Path, port: int, show: bool, ready: Callable[[str], None]
) -> None:
    """Serve the page on 127.0.0.1 until Ctrl-C; `ready` is called with its address."""
    try:
        server = _Server(port, _Answers(session, output))
    except OSError as error:
        raise ValueError(
            f"port {port} cannot be opened ({error.strerror}); give another --port"
        ) from None
    with server:
        ready(server.address)
        if show:
            threading.Thread(target=_show, args=(server.address,), daemon=True).start()
        server.serve_forever()


class _Server(ThreadingHTTPServer):
    """A server on 127.0.0.1 whose address has a secret in it."""

    def __init__(self, port: int, actions: _Answers) -> None:
        super().__init__(("127.0.0.1", port), _Handler)
        self.actions, self.one = actions, threading.Lock()  # one answer at a time
        self.secret = secrets.token_urlsafe(16)
        self.hosts = {f"{name}:{self.server_port}" for name in ("127.0.0.1", "localhost")}
        self.address = f"http://127.0.0.1:{self.server_port}/{self.secret}/"

    def handle_error(self, request: Any, client_address: Any) -> None:
        # a browser closes connections when it likes, also amid an answer
        if not isinstance(sys.exc_info()[1], ConnectionError):
            super().handle_error(request, client_address)


class _Handler(BaseHTTPRequestHandler):
    """Answers requests that have the secret of the address and a Host of this machine.

    A page of a stranger knows neither the one nor, by DNS rebinding, the other.
    """

    protocol_version = "HTTP/1.1"
    server: _Server

    def _reply(self, status: int, body: bytes, kind: str) -> None:
        self.send_response(status)
        for name, value in (
            ("Content-Type", kind),
            ("Content-Length", str(len(body))),
            ("Cache-Control", "no-store"),
            ("Referrer-Policy", "no-referrer"),
            ("X-Content-Type-Options", "nosniff"),
            ("Content-Security-Policy", _POLICY),
        ):
            self.send_header(name, value)
        self.end_headers()
        self.wfile.write(body)

    def _requested(self) -> str | None:
        """The name in a request of the page; None, and a refusal, of a stranger."""
        parts = urlsplit(self.path).path.split("/")
        host = self.headers.get("Host", "")
        origin = self.headers.get("Origin", f"http://{host}")
        if (
            host not in self.server.hosts
            or origin != f"http://{host}"
            or len(parts) != 3
            or not secrets.compare_digest(parts[1].encode(), self.server.secret.encode())
        ):
            self.close_connection = True
            self._reply(403, b"This page is open to the address that piv view printed.\n", TEXT)
            return None
        return parts[2]

    def do_GET(self) -> None:
        name = self._requested()
        if name is None:
            return
        if name == "":
            page = files("piv.view").joinpath("page.html").read_bytes()
            self._reply(200, page, "text/html; charset=utf-8")
        elif name == "image":
            query = dict(parse_qsl(urlsplit(self.path).query))
            # its values are numbers as JSON writes them
            self._answer(name, "{" + ",".join(f'"{k}":{v}' for k, v in query.items()) + "}")
        else:
            self._reply(404, b"no such thing\n", TEXT)

    def do_POST(self) -> None:
        name = self._requested()
        if name is None:
            return
        length = self.headers.get("Content-Length", "")
        good = length.isdecimal() and len(length) < 9 and int(length) <= LONGEST
        if not good or self.headers.get("Content-Type") != JSON:
            self.close_connection = True
            self._reply(400, b"not a request of the page\n", TEXT)
            return
        self._answer(name, self.rfile.read(int(length)))

    def _answer(self, name: str, content: bytes | str) -> None:
        action = None if name.startswith("_") else getattr(self.server.actions, name, None)
        if not callable(action):
            self._reply(404, b"no such thing\n", TEXT)
            return
        try:
            values = json.loads(content or b"{}", parse_constant=_refuse)
            with self.server.one:
                answer = action(**values)
        except Exception as error:  # whatever a stranger's values raise in the libraries
            text = sentence(error) or f"not a request of the page ({one_line(error)})"
            self._reply(422, text.encode(), TEXT)
            return
        if isinstance(answer, bytes):
            self._reply(200, answer, "image/png")
        else:
            self._reply(200, json.dumps(answer, default=plain).encode(), JSON)

    def log_message(self, *_: Any) -> None:
        pass


def _show(address: str) -> None:
    """Open the browser by a file of the user's alone: the list of processes shows its words."""
    import webbrowser

    with tempfile.NamedTemporaryFile("w", suffix=".html") as file:  # mode 0600
        file.write(f'<meta http-equiv="refresh" content="0; url={address}">')
        file.flush()
        webbrowser.open(Path(file.name).as_uri())
        time.sleep(_SHOWN)


def _refuse(word: str) -> Any:
    raise ValueError(f"{word} is no number")


_POLICY = (
    "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; "
    "img-src 'self' blob: data:; connect-src 'self'"
)
TEXT, JSON = "text/plain; charset=utf-8", "application/json"
