"""Stage compare: CFD and PIV, judged by the scene's findings, or without any by agreement alone.

Writes comparison.json and comparison.csv. postprocess.lab compares a laboratory's data.
"""

import platform
from math import isfinite
from pathlib import Path
from typing import Any

import xarray as xr

from pipeline.formats.records import COMPARISON, RUN
from pipeline.scene.scene import Scene
from piv.files.atomic import sha256
from piv.files.provenance import versions
from piv.files.record import read_record
from postprocess.compare.findings import (
    Finding,
    is_met,
    judge_sentence,
    read_findings,
    read_sentences,
)
from postprocess.compare.quantities import QUANTITIES
from postprocess.compare.resolution import SCALED, Resolution, resolution, widened
from postprocess.compare.series import closing, series_table, summary
from postprocess.evidence.evidence import Evidence, Measured, Part
from postprocess.evidence.load import load_evidence
from postprocess.evidence.stage_files import StageFiles
from postprocess.evidence.time_windows import interval
from postprocess.evidence.tip_vortex import ENOUGH, KNOWN, dominant_tracks, strengths
from postprocess.tables import write_table
from postprocess.words import VERDICTS, measured_text
from postprocess.words import quantity as quantity_text

_INPUTS = ("solve", "sheet", "images", "piv", "vortices_cfd", "vortices_piv")
_COPIED = (
    *("id", "kind", "finding", "figure", "quantity", "comparison"),
    *("value", "tolerance", "reason"),
)
_KNOWN = quantity_text(KNOWN, "fraction")
_HIDDEN = {
    "piv": "missing vectors hide the vortex; set a smaller piv.window or camera.scale_mm_per_px",
    "cfd": "the sheet's points are too far apart for the vortex; set a smaller sheet.spacing",
}
_AGREEMENT = Path(__file__).parent / "agreement.toml"  # for a scene without findings


def judge(finding: Finding, evidence: Evidence, seen: Resolution | None = None) -> dict[str, Any]:
    """One check: what each source measures, and whether the finding is met.

    What never happens or cannot be measured is not met. Nothing is judged of what was not run, of
    what is known at too few instants, and of an agreement that misses its limit by no more than
    the recording can resolve (`seen`); of the last two `cure` says why, and what to set.
    """
    measured: dict[str, Measured | None] = dict.fromkeys(finding.of)
    notes: list[str] = []
    absent = {of for of in finding.of if not evidence.has(of)}
    quantity, window, cure = QUANTITIES[finding.quantity], None, ""
    try:
        window = interval(finding.window, evidence.clock)
    except ValueError as error:
        notes.append(str(error))
    for of in finding.of:
        if of in absent or window is None:
            continue
        part = Part(evidence, of, window, finding.finger)
        try:
            if quantity.known:
                some, every = quantity.known(part)
                if some < ENOUGH * every:
                    absent.add(of)
                    cure = (
                        f"the circulation is known to {_KNOWN} at {some} of {every} instants,"
                        f" because {_HIDDEN['piv' if 'piv' in of else of]}"
                    )
                    continue
                notes.append(f"Measured at {some} of {every} instants.")
            value = quantity.measure(part)
            if not (isinstance(value, str) or isfinite(value)):
                raise ValueError(f"{finding.quantity} of {of} {part.words()} is no number")
            measured[of] = value
        except (ValueError, FileNotFoundError) as error:
            notes.append(str(error))
            if isinstance(error, FileNotFoundError):
                absent.add(of)
            elif finding.window.kind == "known" and _seen_briefly(evidence):
                absent.add(of)
                cure = f"flow and PIV both see the vortex too briefly, because {_HIDDEN['piv']}"
    judged = {
        of: value is not None and is_met(finding, value)
        for of, value in measured.items()
        if of not in absent
    }
    met = False if not all(judged.values()) else None if absent else True
    if met is False and seen and finding.kind == "agreement" and finding.quantity in SCALED:
        wide = widened(finding, seen.factor(finding.quantity))
        if all(value is not None and is_met(wide, value) for value in measured.values()):
            met, cure = None, seen.cure
    if cure:
        notes.append(f"{'Not judged' if met is False else 'Undecided'}: {cure}.")
    return {
        **{name: getattr(finding, name) for name in _COPIED},
        "label": quantity.label,
        "unit": quantity.unit,
        "window": finding.window.words(),
        "window_s": window,
        "measured": measured,
        "met_by": judged,
        "met": met,
        "cure": cure,
        "notes": list(dict.fromkeys(notes)),
    }


def _seen_briefly(evidence: Evidence) -> bool:
    """Whether flow and PIV both find the tip's vortex, for less than a window that is judged."""
    clock = evidence.clock
    return not clock.known and len(dominant_tracks(evidence.vortices, 0, clock.stroke())) > 1


def _agrees(checks: list[dict[str, Any]]) -> bool | None:
    """Whether PIV agrees with the CFD; None: undecided."""
    met = [check["met"] for check in checks if check["kind"] == "agreement"]
    return False if False in met else None if None in met or not met else True


def _provenance(
    out: Path, run: dict[str, Any], findings: Path | None, planes: dict[str, xr.Dataset]
) -> dict[str, Any]:
    """Versions, digests of what the stages before were made from, seeds; `run` as in run.json."""
    records = {stage: read_record(out, stage) for stage in _INPUTS}
    libraries = versions("numpy", "scipy", "xarray", "h5py", "pandas")
    return {
        "versions": {"python": platform.python_version()} | libraries | run.get("versions", {}),
        "made_from": {stage: record["digest"] for stage, record in records.items() if record},
        "findings_sha256": None if findings is None else sha256(findings),
        "seeds": {s: int(p.attrs["seed"]) for s, p in planes.items() if "seed" in p.attrs},
    }


def compare(files: StageFiles) -> dict[str, Any]:
    """Compare one scene at one level and write the files; returns what comparison.json holds."""
    own = files.findings if files.findings.exists() else None
    findings = read_findings(own or _AGREEMENT, frozenset(QUANTITIES))
    sentences = read_sentences(own or _AGREEMENT, findings)
    if not files.numbers.filmed:  # nothing is judged on a page of the flow alone
        own, findings, sentences = None, (), ()
    evidence = load_evidence(files)
    out = files.out
    run = RUN.read(files.required("run/run.json", "solve"))
    clock = evidence.clock
    middle, judged = clock.middle(), clock.judged()
    if own is None and strengths(evidence.vortices["cfd"], 0, clock.stroke()).empty:
        # A flow without a vortex is compared by its velocities alone.
        findings = tuple(finding for finding in findings if finding.quantity.startswith("velocity"))
    seen = None
    if evidence.has("piv"):
        tips = dominant_tracks(evidence.vortices, 0, judged)
        tip = next(iter(tips.values()), evidence.vortices["piv"].iloc[:0])
        seen = resolution(files.numbers, tip[tip["time"].between(*judged)], evidence.scale)
    checks = [judge(finding, evidence, seen) for finding in findings]
    pinch = {"pinch": closing(clock)} if evidence.pairs else {}
    result = {
        "scene": files.scene,
        "level": files.level,
        "sources": list(evidence.planes),
        "scale": {"name": "peak speed of the finger's tip", "value": evidence.scale, "unit": "m/s"},
        "middle_of_stroke_s": middle,
        "judged_s": judged,
        "judged": "known" if clock.known else "middle",
        "verdict": {"agrees": _agrees(checks)},
        "checks": checks,
        "sentences": [judge_sentence(sentence, checks) for sentence in sentences],
        "summary": summary(evidence, judged) | pinch,
        "provenance": _provenance(out, run, own, evidence.planes),
    }
    write_table(out / "comparison.csv", series_table(evidence, judged))
    for name in ("pairs", "lines", "integrals"):
        for source, table in getattr(evidence, name).items():
            file = "centreline" if name == "lines" else name
            write_table(out / f"{file}_{source}.csv", table)
    # last: make takes it for the whole stage
    COMPARISON.write(out / "comparison.json", result)
    for plane in evidence.planes.values():
        plane.close()
    return result


def run(scene: Scene, quiet: bool = False) -> None:
    """Run the stage compare."""
    files = StageFiles(scene)
    result = compare(files)
    if quiet:
        return
    if scene.filmed and not files.findings.exists():
        print(f"{files.findings} is missing: only the agreement of PIV with the CFD is judged")
    for check in result["checks"]:
        print(f"{check['id']:32s} {VERDICTS[check['met']]:10s} {measured_text(check)}")
    print(files.out / "comparison.json")
