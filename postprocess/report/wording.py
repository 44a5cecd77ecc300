"""Numbers and verdicts in words, for a reader who does not know the code."""

from __future__ import annotations

from typing import Any

from postprocess.draw.quantity_text import NBSP, PAIRS, measured_text, quantity

WORDS = {True: "met", False: "not met", None: "not judged"}


def balance_sentence(balance: dict[str, Any]) -> str:
    """What has become of the finger's work, of run.json's `power_balance`."""
    taken, work = balance["taken"], abs(balance["work"]) or 1.0
    part = lambda *names: f"{sum(taken[name] for name in names) / work:.0%}"  # noqa: E731
    return (
        f"Of the finger's work on the water, {balance['work'] * 1e3:.3f}{NBSP}mJ, {balance['kinetic_energy'] / work:.0%} is kinetic"
        f" energy at the end; viscosity has taken {part('viscous')}, the convection scheme {part('convection')}, the coupling of pressure"
        f" and velocity {part('coupling')}; {balance['unexplained_fraction']:.1%} is unexplained. What the schemes take acts as"
        " viscosity of the mesh: the computed vortices lose it sooner than those in the water."
    )


def requirement(check: dict[str, Any]) -> str:
    """What a check asks for, its tolerance included."""
    unit, value, tolerance = check["unit"], check["value"], check["tolerance"]
    extra = f" ± {quantity(tolerance, unit)}" if tolerance else ""
    if isinstance(value, str):
        return value
    if check["comparison"] == "in range":
        return f"{quantity(value[0], unit)} to {quantity(value[1], unit)}{extra}"
    sign = {"<=": "at most ", ">=": "at least ", "equals": ""}[check["comparison"]]
    return f"{sign}{quantity(value, unit)}{extra}"


def sentence_rows(comparison: dict[str, Any]) -> list[tuple[str, str, str, str, str]]:
    """The paper's sentences: quote, where, reading, what was measured or why nothing can be, and the verdict."""
    checks = {check["id"]: check for check in comparison["checks"]}
    rows = []
    for entry in comparison.get("sentences", []):
        measured = [
            f"{checks[name]['label']}: {measured_text(checks[name])}" for name in entry["findings"]
        ]
        text = "; ".join(measured) + (". " if measured and entry["why"] else "") + entry["why"]
        rows.append((entry["quote"], entry["where"], entry["reading"], text, entry["verdict"]))
    return rows


def answer(comparison: dict[str, Any], trial: str = "") -> str:
    """The page's first sentence: does the simulation agree with PIV of pictures that are made from it?

    `trial`: why the level shows nothing but that everything works, where it is such a one.
    """
    paper = [check for check in comparison["checks"] if check["kind"] == "paper"]
    if "piv" not in comparison["sources"]:
        shown = sum(check["met_by"].get("cfd") is True for check in paper)
        findings = f"; it shows {shown} of the paper's {len(paper)} findings" if paper else ""
        return f"Not judged: PIV was not run at level {comparison['level']}, so this page shows the simulation alone{findings}."
    agrees = comparison["verdict"]["agrees"]
    start = {
        True: "Yes, PIV of pictures made from this simulation agrees with it",
        False: "No, PIV of pictures made from this simulation does not agree with it in every check",
        None: "Not fully judged",
    }[agrees]
    if trial:
        missed = (
            ""
            if agrees is None
            else " and agrees with it"
            if agrees
            else " and misses a limit of full levels"
        )
        start = f"A trial: {trial}. PIV of pictures made from this simulation works{missed}"
    met = sum(check["met"] is True for check in paper)
    numbers = _numbers(comparison["summary"]["piv-cfd"], comparison)
    findings = f"; both show {met} of the paper's {len(paper)} findings" if paper else ""
    return f"{start}: over the middle of the stroke {numbers}{findings}."


def _numbers(pair: dict[str, Any], comparison: dict[str, Any]) -> str:
    allowed = {c["quantity"]: c["value"] for c in comparison["checks"] if c["kind"] == "agreement"}

    def limit(name, unit):
        return f" (allowed {quantity(allowed[name], unit)})" if name in allowed else ""

    vortex = (
        "the flow has no tip vortex"
        if pair["centre_rms_distance"] is None and "cfd" not in comparison["summary"]
        else "the tip vortex is not found in both"
        if pair["centre_rms_distance"] is None
        else f"the circulation of the tip vortex differs by {quantity(pair['circulation_rms_difference'], 'fraction')}"
        f"{limit('circulation_difference', 'fraction')}, its centre by {quantity(pair['centre_rms_distance'], 'm')}"
        f"{limit('centre_distance', 'm')}"
    )
    speed = quantity(pair["velocity_rms_difference_relative"], "fraction")
    return f"{vortex} and the velocity differs by {speed} of the peak tip speed{limit('velocity_rms_difference', 'fraction')}"


def rows(comparison: dict[str, Any]) -> list[dict[str, Any]]:
    """The verdict table: one row per check, everything as text but `met`."""
    return [
        {
            "id": check["id"],
            "kind": check["kind"],
            "finding": check["finding"],
            "figure": check["figure"],
            "label": check["label"],
            "required": requirement(check),
            "measured": [
                (PAIRS[of], quantity(value, check["unit"]), check["met_by"].get(of))
                for of, value in check["measured"].items()
            ],
            "met": check["met"],
            "word": WORDS[check["met"]],
            "reason": check["reason"],
            "window": check["window"] + _seconds(check["window_s"]),
            "notes": check["notes"],
        }
        for check in comparison["checks"]
    ]


def _seconds(window: list[float] | None) -> str:
    return "" if window is None else ", {:.3f} to {:.3f} s".format(*window)


def tiles(comparison: dict[str, Any]) -> list[tuple[str, str, str]]:
    """Key numbers of the first screen: value, name, remark."""
    summary, scale = comparison["summary"], comparison["scale"]["value"]
    out = [(f"{scale:.3f} m/s", "peak speed of the tip", "the scale of every velocity difference")]
    for source in ("cfd", "piv"):
        if source in summary:
            mean = summary[source]["circulation_mean"] * 1e4
            sense = "clockwise" if mean < 0 else "counter-clockwise"
            # each source's own instants: where PIV finds the vortex at fewer of them, the means are of other times
            remark = (
                f"mean of {summary[source]['instants']} instants in the middle of the stroke; {sense}, "
                f"{summary[source]['side'] or 'undecided'} side"
            )
            out.append((f"{abs(mean):.1f} cm²/s", f"tip vortex, {PAIRS[source]}", remark))
    if "piv-cfd" not in summary:
        return out
    pair = summary["piv-cfd"]
    for name, rms, worst, unit in (
        (
            "difference of circulation",
            "circulation_rms_difference",
            "circulation_max_difference",
            "fraction",
        ),
        ("distance of the centres", "centre_rms_distance", "centre_max_distance", "m"),
    ):
        if pair[rms] is not None:
            remark = f"RMS where both find it; worst instant {quantity(pair[worst], unit)}"
            out.append((quantity(pair[rms], unit), name, remark))
    value = quantity(pair["velocity_rms_difference_relative"], "fraction")
    remark = f"of the peak tip speed; correlation {quantity(pair['velocity_correlation'], '1')}"
    out.append((value, "velocity difference (RMS)", remark))
    return out
