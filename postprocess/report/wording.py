"""A comparison in words, for a reader who does not know the code."""

from typing import Any

from postprocess.words import NBSP, PAIRS, VERDICTS, measured_text, quantity


def balance_sentence(balance: dict[str, Any]) -> str:
    """What has become of the finger's work, of run.json's `power_balance`."""
    if "supplied" in balance:
        return _with_current(balance)
    work, unexplained = abs(balance["work"]) or 1.0, balance["unexplained_fraction"]
    parts = balance["taken"] | {"kinetic": balance["kinetic_energy"]}
    of = {name: quantity(value / work, "fraction") for name, value in parts.items()}
    return (
        f"Of the finger's work on the water, {1e3 * balance['work']:.3f}{NBSP}mJ, {of['kinetic']}"
        f" is kinetic energy at the end; viscosity has taken {of['viscous']}, the convection scheme"
        f" {of['convection']}, the coupling of pressure and velocity {of['coupling']};"
        f" {quantity(unexplained, 'fraction')} is unexplained. What the schemes take acts as"
        " viscosity of the mesh: the computed vortices lose it sooner than those in the water."
    )


def _with_current(balance: dict[str, Any]) -> str:
    """The same with a current, which brings energy and takes it away."""
    parts = {"work": balance["work"], "supplied": balance["supplied"]} | balance["taken"]
    parts["kinetic"], parts["rest"] = balance["kinetic_energy"], abs(balance["unexplained"])
    of = {name: f"{1e3 * value:.3g}{NBSP}mJ" for name, value in parts.items()}
    return (
        f"The water gains {of['work']} by the finger and {of['supplied']} through the tank's ends"
        " (negative: it loses them). The water's kinetic energy changes by"
        f" {of['kinetic']}; viscosity has taken {of['viscous']}, the convection scheme"
        f" {of['convection']}, the coupling of pressure and velocity {of['coupling']};"
        f" {of['rest']} are unexplained,"
        f" {quantity(abs(balance['unexplained_fraction']), 'fraction')} of what finger, current and"
        " water exchange. What the schemes take acts as viscosity of the mesh."
    )


def power_sentence(balance: dict[str, Any]) -> str:
    """How much of the finger's work the schemes take, and how much is unexplained."""
    taken = balance["taken"]
    schemes = (taken["convection"] + taken["coupling"]) / (abs(balance["work"]) or 1.0)
    warning = balance.get("warning")
    if "supplied" in balance:
        return (f"Warning: {warning}. " if warning else "") + _with_current(balance)
    return (
        (f"Warning: {warning}. " if warning else "")
        + "Of the finger's work on the water the numerical schemes take"
        f" {100 * schemes:.0f}{NBSP}%, which the water would not;"
        f" {quantity(abs(balance['unexplained_fraction']), 'fraction')} is unexplained."
    )


def requirement(check: dict[str, Any]) -> str:
    """What a check asks for, its tolerance included."""
    unit, value, tolerance = check["unit"], check["value"], check["tolerance"]
    if isinstance(value, str):
        return value
    extra = f" ± {quantity(tolerance, unit)}" if tolerance else ""
    if check["comparison"] == "in range":
        return f"{quantity(value[0], unit)} to {quantity(value[1], unit)}{extra}"
    sign = {"<=": "at most ", ">=": "at least ", "equals": ""}[check["comparison"]]
    return f"{sign}{quantity(value, unit)}{extra}"


_TRIAL = "not judged"  # by a level that is for trying out
_SENTENCES = {"met": True, "not met": False}
_ABOUT = {
    "circulation_difference": "the circulation of the tip vortex",
    "centre_distance": "the place of the tip vortex",
    "centre_distance_relative": "the place of the tip vortex",
    "velocity_rms_difference": "the velocity",
    "velocity_correlation": "the pattern of the flow",
}


def quoted(
    comparison: dict[str, Any], pictures: list[dict[str, Any]], trial: bool = False
) -> tuple[list[tuple[dict[str, Any] | None, list[dict[str, Any]]]], list[dict[str, Any]]]:
    """The paper's sentences beside the picture of their time, and the pictures that remain.

    A sentence that no finding tests has none; a trial judges nothing.
    """
    checks = {check["id"]: check for check in comparison["checks"]}
    groups: dict[int | None, list[dict[str, Any]]] = {}
    for entry in comparison.get("sentences", []):
        tested = [checks[name] for name in entry["findings"]]
        measured = [f"{check['label']}: {measured_text(check)}" for check in tested]
        text = "; ".join(measured) + (". " if measured and entry["why"] else "") + entry["why"]
        met = None if trial else _SENTENCES.get(entry["verdict"])
        word = "not tested" if not entry["findings"] else _TRIAL if trial else VERDICTS[met]
        windows = [check["window_s"] for check in tested if check["window_s"]]
        beside = None
        if windows:
            time = sum(windows[0]) / 2
            beside = min(range(len(pictures)), key=lambda k: abs(pictures[k]["time"] - time))
        row = entry | {"measured": text[:1].upper() + text[1:], "met": met, "word": word}
        groups.setdefault(beside, []).append(row)
    shown = sorted(groups, key=lambda k: len(pictures) if k is None else k)
    rest = [picture for k, picture in enumerate(pictures) if k not in groups]
    return [(None if k is None else pictures[k], groups[k]) for k in shown], rest


def answer(comparison: dict[str, Any], trial: str = "") -> str:
    """The page's first sentence: does the simulation agree with PIV of pictures made from it?

    `trial`: why the level shows only that everything works, where it is such a one.
    """
    paper = [check for check in comparison["checks"] if check["kind"] == "paper"]
    if not comparison["checks"]:
        alone = "The flow alone, without camera and PIV"
        if trial:
            return f"{alone}; its numbers are not those of the finger: {trial}."
        return f"{alone}: nothing is judged."
    agrees = comparison["verdict"]["agrees"]
    subject = "PIV of pictures made from this simulation"
    if trial:
        return f"Works; its numbers are not those of the finger: {trial}."
    start = {
        True: f"Agrees: {subject} shows its flow",
        False: f"Differs: {subject} does not agree with it in {_failing(comparison, False)}",
        None: f"Undecided in {_failing(comparison, None)}: {_cures(comparison)}",
    }[agrees]
    met = sum(check["met"] is True for check in paper)
    findings = f"; both show {met} of the paper's {len(paper)} findings" if paper else ""
    return f"{start}; {judged_words(comparison)} {_numbers(comparison)}{findings}."


def judged_words(comparison: dict[str, Any]) -> str:
    """When flow and PIV are compared."""
    first, last = comparison["judged_s"]
    if comparison["judged"] == "known":
        return f"from {first:.3f} to {last:.3f}{NBSP}s, while both know the tip vortex,"
    return f"over the middle of the stroke, {first:.3f} to {last:.3f}{NBSP}s,"


def _failing(comparison: dict[str, Any], met: bool | None) -> str:
    """The agreement checks of one verdict by what they are about."""
    checks = (c for c in comparison["checks"] if c["kind"] == "agreement" and c["met"] is met)
    return ", ".join(dict.fromkeys(_ABOUT.get(c["quantity"], c["label"]) for c in checks))


def _cures(comparison: dict[str, Any]) -> str:
    """Why agreement checks are undecided, and what to set."""
    cures = (c["cure"] for c in comparison["checks"] if c["kind"] == "agreement" and c["cure"])
    return "; ".join(dict.fromkeys(cures))


def _judged_at(pair: dict[str, Any]) -> str:
    return f"{pair['circulation_instants']} of {pair['instants']} instants"


def _numbers(comparison: dict[str, Any]) -> str:
    pair = comparison["summary"]["piv-cfd"]
    allowed = {c["quantity"]: c["value"] for c in comparison["checks"] if c["kind"] == "agreement"}

    def limit(name: str, unit: str) -> str:
        return f" (allowed {quantity(allowed[name], unit)})" if name in allowed else ""

    if pair["centre_rms_distance"] is not None:
        vortex = "the centre of the tip vortex differs"
        if pair["circulation_rms_difference"] is not None:
            vortex = (
                "the circulation of the tip vortex differs by"
                f" {quantity(pair['circulation_rms_difference'], 'fraction')}"
                f"{limit('circulation_difference', 'fraction')} at {_judged_at(pair)}, its centre"
            )
        vortex += f" by {quantity(pair['centre_rms_distance'], 'm')}{limit('centre_distance', 'm')}"
    elif "cfd" in comparison["summary"]:
        vortex = "the tip vortex is not found in both"
    else:
        vortex = "the flow has no tip vortex"
    speed = quantity(pair["velocity_rms_difference_relative"], "fraction")
    return (
        f"{vortex} and the velocity differs by {speed} of the peak tip speed"
        f"{limit('velocity_rms_difference', 'fraction')}"
    )


def rows(comparison: dict[str, Any], trial: bool = False) -> list[dict[str, Any]]:
    """The verdict table: one row per check, all as text but `met`; a trial judges nothing."""
    out = []
    for check in comparison["checks"]:
        window = check["window_s"]
        seconds = "" if window is None else ", {:.3f} to {:.3f} s".format(*window)
        measured = [
            (PAIRS[of], quantity(value, check["unit"]), check["met_by"].get(of))
            for of, value in check["measured"].items()
        ]
        met = None if trial else check["met"]
        more = {
            "required": requirement(check),
            "word": _TRIAL if trial else VERDICTS[met],
            "met": met,
        }
        out.append(check | more | {"measured": measured, "window": check["window"] + seconds})
    return out


def tiles(comparison: dict[str, Any], end: float | None) -> list[tuple[str, str, str]]:
    """Key numbers of the first screen: value, name, remark.

    `end`: instant (s) at which the numbers of the level end, if that is known.
    """
    summary, scale = comparison["summary"], comparison["scale"]["value"]
    out = [
        (quantity(scale, "m/s"), "peak speed of the tip", "the scale of every velocity difference")
    ]
    window = "{:.3f} to {:.3f} s".format(*comparison["judged_s"])
    ended = ""
    if end is not None and end < comparison["judged_s"][1]:
        ended = f"; the level's numbers end at {end:.3f} s"
    for source in ("cfd", "piv"):
        if source in summary:
            mean = summary[source]["circulation_mean"]
            sense = "clockwise" if mean < 0 else "counter-clockwise"
            count = summary[source]["instants"]
            remark = (
                f"mean of {count} instant{'s' * (count != 1)}, {window};"
                f" {sense}, {summary[source]['side'] or 'undecided'} side{ended}"
            )
            out.append((quantity(abs(mean), "m²/s"), f"tip vortex, {PAIRS[source]}", remark))
    if "piv-cfd" not in summary:
        return out
    pair = summary["piv-cfd"]
    judged = f"at {_judged_at(pair)} from {window}"
    for name, key, unit, where in (
        ("difference of circulation", "circulation_{}_difference", "fraction", judged),
        ("distance of the centres", "centre_{}_distance", "m", f"where both find it, {window}"),
    ):
        if pair[key.format("rms")] is not None:
            worst = quantity(pair[key.format("max")], unit)
            remark = f"RMS {where}; worst instant {worst}"
            out.append((quantity(pair[key.format("rms")], unit), name, remark))
    value = quantity(pair["velocity_rms_difference_relative"], "fraction")
    remark = f"of the peak tip speed, over all vectors, {window}"
    return [*out, (value, "velocity difference (RMS)", remark)]


def absences(comparison: dict[str, Any], finger: bool) -> list[str]:
    """One sentence for each optional part that the page lacks; `finger`: not a rigid body."""
    seen, has_piv = comparison["summary"], "piv" in comparison["sources"]
    middle = "shows no vortex near the tip from {:.3f} to {:.3f} s".format(*comparison["judged_s"])
    notes = {
        "The scene has no findings (reference/findings.toml): agreement of PIV with the CFD is"
        " judged and nothing else.": comparison["checks"]
        and comparison["provenance"]["findings_sha256"] is None,
        f"PIV {middle}, so the two vortices are not compared.": has_piv and "piv" not in seen,
        f"The CFD {middle}, so its series is not drawn.": "cfd" not in seen,
        "The uncertainty of the finger's shape and pressure (FEA band) was not propagated: bands"
        " show the measurement alone.": finger,
    }
    return [note for note, holds in notes.items() if holds]
