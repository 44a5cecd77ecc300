"""The twin's page: the film with predicted outlines, the tip over time, and the parameters."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from piv.files.atomic import write_text
from postprocess.draw.style import CFD, MM, SHADED, WIDTH, new_figure
from postprocess.report.page_template import data_uri, page_template
from softfinger.twin.advice import advice, half_widths
from softfinger.twin.fit import Fit
from softfinger.twin.identify import CLOSE, GROUPS, Judged, warnings
from softfinger.twin.model import LOADS, LOSS, STIFF, Twin

_PICTURES = 4  # of a film


def write_page(
    path: Path,
    twin: Twin,
    found: Fit,
    fitted: list[Judged],
    held: Judged | None,
    more: dict[str, Any],
) -> None:
    """Write identify.html. `more`: what `record` adds."""
    strokes = [*(("fitted", one) for one in fitted), *([("held out", held)] if held else [])]
    text = page_template("twin.html").render(
        title=twin.scene.title,
        rows=found.table(),
        warnings=warnings(found),
        air=twin.air,
        close=CLOSE,
        rms=found.rms,
        noise=found.noise,
        rubber=(STIFF, LOADS, LOSS),
        now=half_widths(found, found.covariance),
        advice=advice(found, more["next"]),
        groups=list(GROUPS),
        next=more["next"],
        coupled=more.get("coupled"),
        compared="fitted" if held is None else "held-out",
        strokes=[
            {
                "name": one.stroke.film.name,
                "kind": kind,
                "summary": one.summary(),
                "motion": one.motion,
                "drawn": one.drawn,
                "film": _data_uri(_film(twin, one)),
                "tip": _data_uri(_tip(one)),
            }
            for kind, one in strokes
        ],
    )
    write_text(path, text)


def _film(twin: Twin, one: Judged) -> Figure:
    """Pictures through the stroke with the predicted outline."""
    film = one.stroke.film
    chosen = np.linspace(0, len(film.times) - 1, _PICTURES).round().astype(int)
    rows, columns = film.images.shape[1:]
    figure, axes = new_figure(2 * WIDTH, 2 * WIDTH / _PICTURES * rows / columns + 0.3, 1, _PICTURES)
    outlines = twin.seen(one.values, one.stroke)
    for ax, k in zip(axes, chosen, strict=True):
        ax.imshow(film.images[k], cmap="gray", vmin=0, vmax=255)
        ax.plot(outlines[k, :, 0], rows - 1 - outlines[k, :, 1], color=CFD)
        ax.set(title=f"{film.times[k]:.3f} s", xlim=(0, columns), ylim=(rows, 0))
        ax.axis("off")
    return figure


def _tip(one: Judged) -> Figure:
    """Place of the tip over time: as the film shows it, and as predicted with its band."""
    figure, axes = new_figure(WIDTH, 4.2, 2, 1, sharex=True)
    time = one.stroke.film.times
    for k, (ax, name) in enumerate(zip(axes, "xy", strict=True)):
        ax.fill_between(time, one.low[:, k] * MM, one.high[:, k] * MM, color=SHADED, label="95 %")
        ax.plot(time, one.predicted[:, k] * MM, color=CFD, label="predicted")
        ax.plot(time, one.seen[:, k] * MM, ".", color="black", ms=4, label="film")
        ax.set_ylabel(f"tip {name}, mm")
    axes[0].legend()
    axes[1].set_xlabel("time, s")
    return figure


def _data_uri(figure: Figure) -> str:
    content = io.BytesIO()
    figure.savefig(content, format="png", dpi=110, facecolor="white")
    return data_uri(".png", content.getvalue())
