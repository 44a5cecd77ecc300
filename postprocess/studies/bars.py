"""Key numbers of a study's runs as bars beside each other."""

from __future__ import annotations

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from postprocess.draw.quantity_text import number
from postprocess.draw.style import CFD, GREY, MM, PIV, THIRD, new_figure

PANELS = (
    ("across_tip_approach", MM, "vortex to the dorsal side\nwhile approaching, mm"),
    ("dorsal_circulation_at_contact", 1e4, "circulation of a dorsal vortex\nat contact, cm²/s"),
    (
        "ventral_circulation_after",
        1e4,
        "circulation of a ventral vortex\n0.15 s after contact, cm²/s",
    ),
    ("jet_peak", 1.0, "peak of the downward\njet, m/s"),
    ("pressure_gap_peak", 1.0, "extreme pressure between\nthe tips, Pa"),
)
COLOURS = {"2d": CFD, "quarter": PIV, "half": THIRD}


def bars(table: pd.DataFrame) -> Figure:
    """One panel per key number, one bar per run (colour: the model); `table` as postprocess.studies.judge gathers it."""
    runs = list(dict.fromkeys(table["run"]))
    models = table.drop_duplicates("run").set_index("run")["model"]
    colours = [COLOURS.get(models[run], GREY) for run in runs]
    figure, axes = new_figure(
        3.1 * len(PANELS) + 1.2, 0.9 + 0.27 * len(runs), 1, len(PANELS), sharey=True
    )
    for ax, (name, unit, label) in zip(axes, PANELS, strict=True):
        rows = table[table["quantity"] == name].set_index("run")["value"]
        values = pd.to_numeric(rows.reindex(runs), errors="coerce").to_numpy(float) * unit
        drawn = ax.barh(runs, np.nan_to_num(values), color=colours, height=0.65)
        ax.bar_label(
            drawn,
            labels=[number(v) if np.isfinite(v) else "–" for v in values],
            padding=3,
            fontsize=8,
        )
        ax.set_xlabel(label)
        ax.margins(x=0.3)
        ax.grid(axis="y", visible=False)
    axes[0].invert_yaxis()
    words = {CFD: "blue", PIV: "orange", THIRD: "green"}
    named = [
        f"{words[COLOURS[model]]}: {model} model" for model in COLOURS if (models == model).any()
    ]
    figure.suptitle(", ".join(named), x=0.01, ha="left", fontsize=11)
    return figure
