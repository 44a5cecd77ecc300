"""How every picture looks: one set of sizes, fonts and colours, and saving whole files."""

import io
from pathlib import Path
from typing import Any

import matplotlib as mpl
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from piv.files.atomic import write_bytes

# Okabe and Ito's colours, told apart by every kind of colour vision
CFD, PIV, LAB = "#0072b2", "#d55e00", "#009e73"
FIRST, SECOND, THIRD, GREY = "#1c2733", "#a4509a", "#8a7a1f", "#737b86"  # whatever is none of those
INK, BODY = "#1c2733", "#49515b"  # text and arrows; the finger, on which marks can be seen
SHADED = "#f3ecd9"  # a span of time
COLOURS = {"cfd": CFD, "piv": PIV}
NAMES = {"cfd": "CFD", "piv": "PIV", "difference": "PIV less CFD"}
WIDTH, HEIGHT = 5.9, 4.2  # inches of every figure that fills half of the page's width
MM = 1e3

_RC: dict[str, Any] = {
    "font.family": "DejaVu Sans",
    "font.size": 10,
    "axes.titlesize": 11,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": "#e3e6ea",
    "grid.linewidth": 0.7,
    "axes.axisbelow": True,
    "lines.linewidth": 1.8,
    "legend.frameon": False,
    "svg.fonttype": "path",
    "pdf.fonttype": 42,  # TrueType, as journals ask for
    "svg.hashsalt": "softfinger",  # equal pictures give equal files
}
# not a context around drawing: titles and labels take their style when they are set
mpl.rcParams.update(_RC)  # type: ignore[arg-type]


def new_figure(
    width: float, height: float, rows: int = 1, columns: int = 1, dpi: float = 110, **more
):
    """An off-screen figure (inches) and its axes; no display and no global state of pyplot."""
    figure = Figure(figsize=(width, height), dpi=dpi, layout="constrained")
    FigureCanvasAgg(figure)
    return figure, figure.subplots(rows, columns, **more)


def save(figure: Figure, path: Path, **more) -> Path:
    """Write a figure in the format of its suffix, whole or not at all."""
    undated = {".svg": {"Date": None}, ".pdf": {"CreationDate": None}}
    if path.suffix in undated:
        more["metadata"] = undated[path.suffix]
    content = io.BytesIO()
    figure.savefig(content, format=path.suffix[1:], facecolor="white", **more)
    write_bytes(path, content.getbuffer())
    return path
