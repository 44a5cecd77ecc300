"""A page of the docs about one scene: what was asked, what was measured, with which versions (docs/<scene>.md)."""

from __future__ import annotations

import argparse
import json
import shutil
import sys
from pathlib import Path
from typing import Any

from postprocess.stagefiles import StageFiles


def measured_cell(check: dict[str, Any]) -> str:
    """Measured values of a check with their sources."""
    parts = []
    for source, value in check["measured"].items():
        shown = f"{value:.3g}" if isinstance(value, float) else str(value)
        parts.append(f"{source}: {shown}")
    return ", ".join(parts)


def verdict_sentence(verdict: dict[str, Any]) -> str:
    """Counts of the verdict as a sentence."""
    kinds = verdict["counts"]
    told = [f"{k['met']} of {k['met'] + k['not_met'] + k['not_judged']} {name}" for name, k in kinds.items()]
    return f"Checks met: {' and '.join(told)} findings."


def page(scene: str, level: str, comparison: dict[str, Any], run: dict[str, Any], picture: str) -> str:
    """The page as Markdown."""
    balance = run["power_balance"]
    rows = "\n".join(
        f"| {c['finding']} | {c['comparison']} {c['value']} {c['unit'] if c['unit'] != '1' else ''} |"
        f" {measured_cell(c)} | {'met' if c['met'] else '**not met**'} |"
        for c in comparison["checks"]
    )
    versions = ", ".join(f"{name} {version}" for name, version in sorted(run["versions"].items()))
    return f"""# {scene}, level {level}

Written by `make docs` from `cases/{scene}/out/{level}/`; scene hash `{run["scene_hash"]}`; {versions}.

![Vectors around the finger, CFD on the left and PIV on the right]({picture})

{verdict_sentence(comparison["verdict"])}

| finding | asked for | measured | |
|---|---|---|---|
{rows}

The reasons of the tolerances are in `cases/{scene}/reference/findings.toml`.

**The run.** {run["cells"]} cells ({run["model"]}), {run["steps"]} steps of {run["time_step"] * 1e3:g} ms, {run["ranks"]} ranks,
{run["wall_time"]:.0f} s of solver; largest Courant number {run["courant_max"]:.2f}. **Power balance**: the finger's work on the water
{balance["work"] * 1e3:.3f} mJ = kinetic energy {balance["kinetic_energy"] * 1e3:.3f} mJ + resolved dissipation
{balance["dissipated"] * 1e3:.3f} mJ + closure {balance["closure"] * 1e3:.3f} mJ ({balance["closure_fraction"]:.0%} of the work): what the schemes
dissipate on this mesh.
"""


def main() -> int:
    """Command line: python -m postprocess.summary cases/single_finger --level coarse --docs docs."""
    parser = argparse.ArgumentParser(prog="python -m postprocess.summary", description=__doc__)
    parser.add_argument("scene", type=Path)
    parser.add_argument("--level", default="coarse")
    parser.add_argument("--docs", type=Path, default=Path("docs"))
    args = parser.parse_args()
    files = StageFiles(args.scene, args.level)
    try:
        comparison = json.loads(files.required("comparison.json", "compare").read_text(encoding="utf-8"))
        run = json.loads(files.required("run/run.json", "run").read_text(encoding="utf-8"))
        flow = sorted((files.out / "figures").glob("flow_*.png"))
        if not flow:
            raise FileNotFoundError(f"{files.figures}: no flow_*.png; run the stage 'report' first")
    except FileNotFoundError as error:
        print(f"summary: {error}", file=sys.stderr)
        return 2
    picture = f"{files.scene}.png"
    shutil.copyfile(flow[len(flow) // 2], args.docs / picture)
    text = page(files.scene, args.level, comparison, run, picture)
    (args.docs / f"{files.scene}.md").write_text(text, encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
