"""The page, drawn by Bokeh and served to this machine alone."""

from __future__ import annotations

from collections.abc import Callable
from html import escape
from pathlib import Path
from typing import Any

import numpy as np
from bokeh.layouts import column, row
from bokeh.models import (
    BoxEditTool,
    Button,
    ColumnDataSource,
    Div,
    PolyDrawTool,
    PolyEditTool,
    Slider,
)
from bokeh.plotting import figure
from bokeh.server.server import Server

from piv.view.regions import clipped, write_regions
from piv.view.scene import Scene

ARROW = 1.6  # grid steps that the 99th percentile of speed is drawn long
HELP = (
    "Step with the slider. Click a vector for its numbers. Polygon tool: hold the button down for "
    "half a second to begin "
    "a mask, click its corners, hold again to end it; Backspace removes the one that is selected. "
    "Box tool: Shift and drag draws the region. A mask that moves: draw it, keep it at this frame, "
    "step on, move its "
    "corners with the polygon edit tool, keep it again."
)


class Page:
    """Widgets and sources of one session; `document` fills a Bokeh document."""

    def __init__(self, scene: Scene, output: Path) -> None:
        self.scene, self.output = scene, output
        self.kept: dict[int, list] = {}
        left, bottom, right, top = self.extent = scene.extent()
        self.image = ColumnDataSource({"image": []})
        self.vectors = ColumnDataSource(scene.vectors(0), name="vectors")
        self.masks = ColumnDataSource({"xs": [], "ys": []}, name="masks")
        self.corners = ColumnDataSource({"x": [], "y": []})
        self.region = ColumnDataSource({"x": [], "y": [], "width": [], "height": []}, name="region")
        self.numbers, self.status = (
            Div(text=HELP, name="numbers", width=900),
            Div(name="status", width=900),
        )
        self.step = Slider(
            start=0,
            end=max(1, scene.count - 1),
            value=0,
            step=1,
            title="step",
            name="step",
            width=600,
        )
        self.plot = figure(
            x_range=(left, right), y_range=(bottom, top), match_aspect=True, width=900, height=650,
            tools="pan,wheel_zoom,reset,tap", active_scroll="wheel_zoom", name="plot",
            x_axis_label=f"x ({scene.unit})", y_axis_label=f"y ({scene.unit})",
        )  # fmt: skip
        self.scale = self._arrow_scale()
        self._draw(right - left, top - bottom)
        self.step.on_change("value", lambda name, old, new: self.show(new))
        self.vectors.selected.on_change("indices", lambda name, old, new: self.tell(new))
        self.show(0)

    def _arrow_scale(self) -> float:
        """Length of an arrow over its speed, the same at every step."""
        arrows = self.scene.vectors(self.scene.count // 2)
        x, speed = np.unique(arrows["x"]), np.hypot(arrows["u"], arrows["v"])
        fast = float(np.percentile(speed, 99)) if speed.size else 0.0
        return ARROW * float(np.diff(x).min()) / fast if x.size > 1 and fast > 0 else 1.0

    def _draw(self, width: float, height: float) -> None:
        left, bottom, *_ = self.extent
        self.plot.image(
            "image", x=left, y=bottom, dw=width, dh=height, palette="Greys256", source=self.image
        )
        arrows = {"x0": "x", "y0": "y", "x1": "x1", "y1": "y1"}
        self.plot.segment(**arrows, source=self.vectors, color="#e66101", line_width=1.2)
        dots = self.plot.scatter(
            "x", "y", source=self.vectors, size=5, color="#e66101", name="dots"
        )
        dots.selection_glyph = dots.glyph.clone(fill_color="#5e3c99", line_color="#5e3c99", size=10)
        masks = self.plot.patches("xs", "ys", source=self.masks, color="#5e3c99", alpha=0.4)
        corners = self.plot.scatter("x", "y", source=self.corners, size=8, color="#5e3c99")
        region = self.plot.rect(
            "x",
            "y",
            "width",
            "height",
            source=self.region,
            fill_alpha=0.0,
            line_color="#008837",
            line_width=2,
        )
        self.plot.add_tools(
            PolyDrawTool(renderers=[masks], vertex_renderer=corners),
            PolyEditTool(renderers=[masks], vertex_renderer=corners),
            BoxEditTool(renderers=[region], num_objects=1),
        )

    def show(self, step: int) -> None:
        """Image and vectors of a step."""
        image = self.scene.image(step)
        self.image.data = {"image": [] if image is None else [image]}
        arrows = self.scene.vectors(step)
        scale = self.scale
        self.vectors.selected.indices = []
        self.vectors.data = arrows | {
            "x1": arrows["x"] + scale * arrows["u"],
            "y1": arrows["y"] + scale * arrows["v"],
        }
        self.plot.title.text = f"{self.scene.time_text(step)}, {arrows['x'].size} vectors"

    def tell(self, indices: list[int]) -> None:
        """Numbers of the vector that was clicked on."""
        if indices:
            values = {
                n: c[indices[0]] for n, c in self.vectors.data.items() if n not in ("x1", "y1")
            }
            self.numbers.text = escape(", ".join(f"{n} = {v:.5g}" for n, v in values.items()))

    def drawn(self) -> list[list[list[float]]]:
        """Polygons on the page now."""
        pairs = zip(self.masks.data["xs"], self.masks.data["ys"], strict=True)
        return [
            [list(map(float, c)) for c in zip(xs, ys, strict=True)] for xs, ys in pairs if len(xs)
        ]

    def keep(self) -> None:
        """Remember the polygons as those of this frame."""
        frame = self.scene.frame_number(int(self.step.value))
        self.kept[frame] = self.drawn()
        self.status.text = (
            f"{len(self.kept[frame])} polygons kept at frame {frame}; frames: {sorted(self.kept)}"
        )

    def save(self) -> None:
        """Write what is drawn; errors appear on the page."""
        kept = self.kept or {0: self.drawn()}
        boxes = list(
            zip(*(self.region.data[n] for n in ("x", "y", "width", "height")), strict=True)
        )
        try:
            roi = clipped(boxes[-1], self.extent) if boxes else None
            message = write_regions(self.output, self.scene.unit, kept, roi)
            if self.drawn() not in kept.values():
                message += "; not saved: the polygons as drawn now; keep them at their frame first"
            self.status.text = escape(message)
        except (ValueError, OSError) as error:
            self.status.text = escape(str(error))

    def document(self, doc: Any) -> None:
        """Fill a document."""
        buttons = []
        actions: tuple[tuple[str, str, Callable[[], None]], ...] = (
            ("keep masks at this frame", "keep", self.keep),
            ("save masks and region", "save", self.save),
        )
        for label, name, action in actions:
            button = Button(label=label, name=name, width=180)
            button.on_click(action)
            buttons.append(button)
        steps = [self.step] if self.scene.count > 1 else []
        doc.title = "piv view"
        doc.add_root(column(row(*steps, *buttons), self.plot, self.numbers, self.status))


def serve(scene: Scene, output: Path, port: int, show: bool, ready: Callable[[str], None]) -> None:
    """Serve the page on 127.0.0.1 until Ctrl-C; `ready` is called with its address."""
    hosts = [f"127.0.0.1:{port}", f"localhost:{port}"]
    try:
        server = Server(
            {"/": lambda doc: Page(scene, output).document(doc)},
            port=port,
            address="127.0.0.1",
            allow_websocket_origin=hosts,
        )
    except OSError as error:
        raise ValueError(
            f"port {port} cannot be opened ({error.strerror}); give another --port"
        ) from None
    server.start()
    ready(f"http://127.0.0.1:{server.port}/")
    if show:
        server.io_loop.add_callback(server.show, "/")
    try:
        server.io_loop.start()
    finally:
        server.stop()
