"""Figures of the ledger, drawn from results files alone."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from postprocess.draw.style import CFD, GREY, PIV, THIRD, new_figure, save

Curves = dict[str, Any]
DASHED = {"ls": "--", "lw": 1}


def oscillating(curves: Curves, path: Path) -> None:
    """In-line force over the cycle with the reference's points and Morison's fit."""
    figure, axes = new_figure(7, 3.4)
    phase = curves["phase"]
    axes.plot(phase, curves["force"], color=CFD, label="computed")
    axes.plot(phase[:-1], curves["fit"], color=GREY, label="Morison's fit", **DASHED)
    axes.plot(phase, curves["viscous"], color=THIRD, lw=1, label="of it friction")
    points = curves["reference_phase"], curves["reference_force"]
    axes.plot(*points, "o", color=PIV, label="Dütsch et al. 1998")
    axes.set(xlabel="t / T", ylabel="force / (ρU²D)")
    axes.legend(ncols=2)
    save(figure, path)


def impulsive(curves: Curves, path: Path) -> None:
    """Drag over time with the reference's points."""
    figure, axes = new_figure(7, 3.4)
    axes.plot(curves["time"], curves["drag"], color=CFD, label="computed")
    axes.plot(curves["time"], curves["friction"], color=THIRD, lw=1, label="of it friction")
    points = curves["reference_time"], curves["reference_drag"]
    axes.plot(*points, "o", color=PIV, label="Koumoutsakos & Leonard 1995")
    axes.set(xlabel="T = Ut/R", ylabel="C_D", ylim=(0, 2), xlim=(0, None))
    axes.legend()
    save(figure, path)


def accelerating(curves: Curves, path: Path) -> None:
    """Force and its two known parts."""
    figure, axes = new_figure(7, 3.4)
    both = np.array(curves["mass_force"]) + np.array(curves["layer"])
    axes.plot(curves["time"], curves["force"], color=CFD, label="computed")
    axes.plot(curves["time"], both, color=PIV, ls="--", label="ρπR² a + wall layer")
    axes.plot(curves["time"], curves["layer"], color=THIRD, lw=1, label="wall layer")
    axes.set(xlabel="t (s)", ylabel="force (N/m)")
    axes.legend()
    save(figure, path)


def plate(curves: Curves, path: Path) -> None:
    """Circulation and displacements over time, logarithmic, with lines of the theory's slope."""
    figure, axes = new_figure(7, 3.6, 1, 2)
    time, span = np.array(curves["time"]), np.array([curves["from"], curves["to"]])
    inside = (time >= span[0]) & (time <= span[1])
    middle = np.sqrt(span[0] * span[1])
    for ax, names, power, label in (
        (axes[0], ("circulation",), "circulation", "Γ / (U c)"),
        (axes[1], ("core", "centroid"), "displacement", "distance from the edge / c"),
    ):
        slope = curves["wanted"][power]
        for name, colour in zip(names, (CFD, THIRD), strict=False):
            value = np.array(curves[name])
            ax.loglog(time, value, ".-", ms=3, lw=1, color=colour, label=name)
            level = np.exp(np.interp(np.log(middle), np.log(time[inside]), np.log(value[inside])))
            ax.loglog(span, level * (span / middle) ** slope, color=PIV, **DASHED)
        ax.plot([], [], color=PIV, label=f"slope {slope:.3g}", **DASHED)
        ax.set(xlabel="t (s)", ylabel=label)
        ax.legend()
    save(figure, path)


def deforming(curves: Curves, path: Path) -> None:
    """Errors over cell size and time step with slopes."""
    figure, axes = new_figure(7, 3.4, 1, 2)

    def slope_line(ax: Any, x: np.ndarray, last: float, slope: int) -> None:
        ax.loglog(x, last * (x / x[-1]) ** slope, color=PIV, label=f"slope {slope}", **DASHED)

    flows = ("", CFD, "Lamb-Oseen", 2), ("wall_", THIRD, "Taylor-Green, walls", 1)
    for part, colour, words, slope in flows:
        size, error = np.array(curves[f"{part}size"]), np.array(curves[f"{part}error"])
        axes[0].loglog(size, error, "o-", color=colour, label=words)
        slope_line(axes[0], size, error[-1], slope)
    axes[0].set(xlabel="cell size (m)", ylabel="velocity (m/s)")
    shared, corrected = curves["size"][: len(curves["corrected"])], curves["corrected"]
    axes[0].loglog(shared, corrected, "s--", color=GREY, ms=4, lw=1, label="skew-corrected")
    step = np.array(curves["step"])
    axes[1].loglog(step, curves["iterated"], "o-", color=CFD, label="iterated")
    axes[1].loglog(step, curves["twice"], "o-", color=GREY, label="two outer correctors")
    axes[1].loglog(step, curves["once"], "o-", color=THIRD, label="one outer corrector")
    for name, slope in (("iterated", 2), ("once", 1)):
        slope_line(axes[1], step, curves[name][-1], slope)
    axes[1].set(xlabel="time step (s)")
    for ax in axes:
        ax.legend()
    save(figure, path)


def grids(curves: Curves, path: Path) -> None:
    """Each quantity over cell size (and time step), as a part of its extrapolated value."""
    parts = [curves[key] for key in curves if key in ("grid", "step")]
    figure, axes = new_figure(7, 3.4, 1, len(parts), squeeze=False)
    words = {"circulation": "Γ", "peak_force": "peak force", "impulse": "impulse"}
    for ax, part in zip(axes[0], parts, strict=True):
        along, label = ("cell", "cell") if "cell" in part else ("time_step", "time step")
        unit = "mm" if along == "cell" else "ms"
        size = 1e3 * np.array(part[along])
        for (name, title), colour in zip(words.items(), (CFD, PIV, THIRD), strict=True):
            q = part["quantities"][name]
            limit = q["extrapolated"]
            value, uncertainty = np.array(q["value"]), np.array(q["uncertainty"])
            ax.errorbar(size, value / limit, uncertainty / abs(limit), fmt="o-", ms=4, lw=1,
                        capsize=3, color=colour, label=title)  # fmt: skip
        ax.axhline(1, color=GREY, lw=0.8)
        ax.set(xlabel=f"{label} ({unit})", xlim=(0, None), ylabel="value / extrapolated")
        ax.legend()
    save(figure, path)


def cantilever(curves: Curves, path: Path) -> None:
    """Deflection of the plates' tips over the rest that they swing about."""
    figure, axes = new_figure(7, 3.0)
    lines = (CFD, "-"), (CFD, "--"), (PIV, "-"), (PIV, "--")
    for (name, curve), (color, style) in zip(curves.items(), lines, strict=True):
        label = name.removeprefix("cantilever_").replace("_", ", ")
        axes.plot(curve["time"], curve["deflection"], color=color, ls=style, lw=1, label=label)
    axes.set(xlabel="t (s)", ylabel="deflection / rest")
    axes.legend(ncols=2)
    save(figure, path)


PLATES = "plate_impulsive", "plate_medium_layer", "plate_thin_layer", "plate_accelerating"
FIGURES: dict[str, Callable[[Curves, Path], None]] = {
    "oscillating_cylinder": oscillating,
    "impulsive_cylinder": impulsive,
    "accelerating_cylinder": accelerating,
    "cantilever_plate": cantilever,
    **dict.fromkeys(PLATES, plate),
    "deforming_mesh": deforming,
    "finger_2d": grids,
    "finger": grids,
}
