"""Comparison of CFD and PIV, judged by the scene's findings or, without them, by agreement alone: comparison.json and comparison.csv.

A laboratory's data are compared by postprocess.lab (make compare).
"""

from __future__ import annotations

import platform
from pathlib import Path
from typing import Any

import xarray as xr

from fileio.atomic import sha256, write_text
from fileio.formats.records import COMPARISON, RUN
from fileio.provenance import versions
from fileio.record import read_record
from pipeline.scene.scene import Scene
from postprocess.compare.conservation import NEEDED, conservation, conservation_numbers
from postprocess.compare.findings import Finding, is_met, read_findings
from postprocess.compare.pinch_summary import pinch_summary
from postprocess.compare.quantities import QUANTITIES
from postprocess.compare.sentences import judge_sentence, read_sentences
from postprocess.compare.series import series_table, summary
from postprocess.evidence.check_finite import first_not_finite
from postprocess.evidence.evidence import Evidence, Measured, Part
from postprocess.evidence.load import load_evidence
from postprocess.evidence.stage_files import StageFiles
from postprocess.evidence.strokes import MIDDLE, stroke_window
from postprocess.evidence.time_windows import interval
from postprocess.evidence.tip_vortex import strengths
from postprocess.words import measured_text

INPUTS = ("run", "sheet", "images", "piv", "vortices_cfd", "vortices_piv")
COPIED = ("id", "kind", "finding", "figure", "quantity", "comparison")
AGREEMENT = Path(__file__).parent / "agreement.toml"  # for a scene that has no findings of its own


def judge(finding: Finding, evidence: Evidence) -> dict[str, Any]:
    """One check: what each source measures, and whether the finding is met (None where something was not run)."""
    measured: dict[str, Measured | None] = dict.fromkeys(finding.of)
    notes: dict[str, str] = {}
    absent = {of for of in finding.of if not evidence.has(of)}
    window = None
    try:
        window = interval(finding.window, evidence.clock)
    except ValueError as error:  # what never happens is a finding not met, and says why
        notes["window"] = str(error)
    for of in finding.of:
        if of in absent or window is None:
            continue
        try:
            value = QUANTITIES[finding.quantity].measure(Part(evidence, of, window, finding.finger))
            if first_not_finite(value) is not None:
                raise ValueError(
                    f"{finding.quantity} of {of} between {window[0]:.3f} and {window[1]:.3f} s is no number"
                )
            measured[of] = value
        except (
            ValueError,
            FileNotFoundError,
        ) as error:  # what cannot be measured is a finding not met, and says why
            notes[of] = str(error)
            if isinstance(error, FileNotFoundError):  # what was not run is not judged
                absent.add(of)
    judged = {
        of: value is not None and is_met(finding, value)
        for of, value in measured.items()
        if of not in absent
    }
    met = False if not all(judged.values()) else None if absent else True
    return {
        **{name: getattr(finding, name) for name in COPIED},
        "label": QUANTITIES[finding.quantity].label,
        "unit": QUANTITIES[finding.quantity].unit,
        "value": finding.value,
        "tolerance": finding.tolerance,
        "reason": finding.reason,
        "window": finding.window.words(),
        "window_s": window,
        "measured": measured,
        "met_by": judged,
        "met": met,
        "notes": list(dict.fromkeys(notes.values())),
    }


def verdict(checks: list[dict[str, Any]]) -> dict[str, Any]:
    """Whether the simulation agrees with PIV (None: not judged), and how many checks of each kind are met."""
    met = {kind: [c["met"] for c in checks if c["kind"] == kind] for kind in ("agreement", "paper")}
    counts = {
        kind: {
            "met": values.count(True),
            "not_met": values.count(False),
            "not_judged": values.count(None),
        }
        for kind, values in met.items()
    }
    agreement = met["agreement"]
    agrees = False if False in agreement else None if None in agreement or not agreement else True
    return {"agrees": agrees, "counts": counts}


def provenance(
    out: Path, run: dict[str, Any], findings: Path | None, planes: dict[str, xr.Dataset]
) -> dict[str, Any]:
    """What the result rests on: versions, what the stages before were made from, seeds."""
    names = ("numpy", "scipy", "xarray", "h5py", "pandas")
    records = {stage: read_record(out, stage) for stage in INPUTS}
    return {
        "versions": {"python": platform.python_version()}
        | versions(*names)
        | run.get("versions", {}),
        "made_from": {stage: record["digest"] for stage, record in records.items() if record},
        "findings_sha256": None if findings is None else sha256(findings),
        "seeds": {s: int(p.attrs["seed"]) for s, p in planes.items() if "seed" in p.attrs},
    }


def compare(files: StageFiles) -> dict[str, Any]:
    """Run the comparison of one scene at one level and write its two files; returns what comparison.json holds."""
    own = files.findings if files.findings.exists() else None
    findings = read_findings(own or AGREEMENT, frozenset(QUANTITIES))
    sentences = read_sentences(own or AGREEMENT, findings)
    evidence = load_evidence(files)
    run = RUN.read(files.required("run/run.json", "run"))
    middle = stroke_window(evidence.clock.time, evidence.clock.progress, MIDDLE)
    # a flow without a vortex to find
    if own is None and strengths(evidence.vortices["cfd"], 0, middle).empty:
        findings = tuple(finding for finding in findings if finding.quantity.startswith("velocity"))
    checks = [judge(finding, evidence) for finding in findings]
    pinch = {"pinch": pinch_summary(evidence)} if evidence.pairs else {}
    if pinch and set(evidence.planes["cfd"]) >= NEEDED:
        balance = conservation(files, evidence.planes["cfd"])
        write_text(files.out / "conservation.csv", balance.to_csv(index=False))
        pinch["pinch"]["cfd"] |= conservation_numbers(
            balance, evidence.clock.met(), run["model"] == "2d"
        )
    result = {
        "scene": files.scene,
        "level": files.level,
        "sources": list(evidence.planes),
        "scale": {"name": "peak speed of the finger's tip", "value": evidence.scale, "unit": "m/s"},
        "middle_of_stroke_s": middle,
        "verdict": verdict(checks),
        "checks": checks,
        "sentences": [judge_sentence(sentence, checks) for sentence in sentences],
        "summary": summary(evidence, middle) | pinch,
        "provenance": provenance(files.out, run, own, evidence.planes),
    }
    write_text(files.out / "comparison.csv", series_table(evidence, middle).to_csv(index=False))
    for source, table in evidence.pairs.items():
        write_text(files.out / f"pairs_{source}.csv", table.to_csv(index=False))
        write_text(
            files.out / f"centreline_{source}.csv", evidence.lines[source].to_csv(index=False)
        )
        write_text(
            files.out / f"integrals_{source}.csv", evidence.integrals[source].to_csv(index=False)
        )
        write_text(files.out / f"halves_{source}.csv", evidence.halves[source].to_csv(index=False))
    if bad := first_not_finite(result):
        raise ValueError(
            f"{files.out / 'comparison.json'}: {bad} would be no number; see the empty cells of comparison.csv from"
            f" {middle[0]:.3f} to {middle[1]:.3f} s"
        )
    # last: make takes it for the whole stage
    COMPARISON.write(files.out / "comparison.json", result)
    for plane in evidence.planes.values():
        plane.close()
    return result


def run(scene: Scene, quiet: bool = False) -> None:
    """Stage compare."""
    files = StageFiles(scene)
    result = compare(files)
    if quiet:
        return
    if not files.findings.exists():
        print(
            f"{files.findings} is missing: agreement of PIV with the CFD is judged, findings are not"
        )
    for check in result["checks"]:
        word = {True: "met", False: "NOT MET", None: "not judged"}[check["met"]]
        print(f"{check['id']:32s} {word:10s} {measured_text(check)}")
    print(files.out / "comparison.json")
