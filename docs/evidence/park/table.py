"""`make park`: runs the own fingers of tests/park/scenes.toml and writes docs/park.md.

python -m docs.evidence.park [NAME ...] [--new SEED]  (none: all scenes; resumes what was made)
"""

import argparse
import json
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from docs.evidence.park.checks import LIMITS, Outcome, checks
from docs.evidence.park.draw import drawn
from docs.evidence.small_scene import ROOT
from pipeline.runs.estimate import of_page
from pipeline.runs.run import Run
from pipeline.runs.stages import STAGES
from piv.files.atomic import write_text
from piv.files.record import read_record
from postprocess.tables import write_table
from softfinger.lengths import lengths
from softfinger.make import Machine, make
from softfinger.new_scene import PARENT, Own, write_scene
from softfinger.options import open_moved
from softfinger.study.table import commit

TABLE = ROOT / "tests" / "park" / "scenes.toml"
FOLDER = ROOT / "cases" / "single_finger" / "out" / "park"
PAGE, CSV = ROOT / "docs" / "park.md", ROOT / "docs" / "park.csv"
LEVEL = "smoke"
_HEAD = """# Own fingers

`make park` makes these scenes from the arguments of `softfinger new` and some keys
(`tests/park/scenes.toml`). It checks what must hold of any scene, at level smoke, coupled and
prescribed. Four are checked at draft, too. Rows with PIV=0 are of the flow alone. Bold is what
fails. A text says why a check does not apply. In a new clone the first scene compiles for 20 s.

"""
_START, _STEP = 0.02, 0.005  # s of rest before a pressure rises, and between its rows


def pressure(how: dict[str, Any]) -> tuple[np.ndarray, np.ndarray]:
    """Times (s) and pressures (Pa) of a scene's entry `pressure`."""
    levels, rise, hold = how["kpa"], how["rise"], how["hold"]
    each = hold if how["kind"] == "sine" else rise + hold
    count = round((_START + each * len(levels)) / _STEP)
    time = _STEP * np.arange(count + 1)
    value = np.zeros_like(time)
    before = 0.0
    for k, level in enumerate(levels):
        since = time - _START - k * each
        part = {
            "ramp": np.clip(since / rise, 0, 1),
            "valve": -np.expm1(-np.maximum(since, 0) / rise),
            "sine": np.sin(2 * np.pi * np.maximum(since, 0) / rise),
        }[how["kind"]]
        value = np.where(since >= 0, before + (level - before) * part, value)
        before = level
    noise = np.random.default_rng(53).normal(0.0, 1.0, time.size) * how.get("noise", 0.0)
    some = 1 if "noise" in how or rise < 1 else int(rise / 0.1)  # a slow one needs fewer rows
    return time[::some], (1e3 * value + noise)[::some]


def new(entry: dict[str, Any], folder: Path) -> None:
    """Write the scene of an entry into a folder, as `softfinger new` does."""
    folder.parent.mkdir(parents=True, exist_ok=True)
    table = folder.parent / f"{folder.name}.csv"
    time, value = pressure(entry["pressure"])
    pd.DataFrame({"t": time, "p": value.round(2)}).to_csv(table, index=False)
    (long,), (wide,) = (lengths(entry[key], key, 1) for key in ("length", "width"))
    x, y, z = lengths(entry["tank"], "tank", 3, "mm")
    write_scene(folder, Own(long, wide, table, (x, y, z)), ROOT / entry.get("extends", PARENT))
    path = folder / "scene.toml"
    text = path.read_text(encoding="utf-8")
    if curves := entry.get("curves"):
        text = text.replace('source = "structure"', 'source = "fea"\nstates = "curves.csv"')
        _arcs(folder / "curves.csv", long, curves)
    write_text(path, f"{text}\n{entry.get('keys', '')}")


def _arcs(path: Path, length: float, curves: dict[str, float]) -> None:
    """Curves of a finger whose bend is proportional to the pressure, from none to the largest."""
    s = np.linspace(0, length, 41)
    rows = []
    for kpa in np.linspace(-0.2, 1.2, 8) * curves["kpa"]:
        turn = np.radians(curves["bend_deg"]) * kpa / curves["kpa"] * s / length
        x, y = (np.r_[0, np.cumsum(0.5 * (f[1:] + f[:-1]) * np.diff(s))]
                for f in (np.cos(turn), np.sin(turn)))  # fmt: skip
        rows += [
            {"pressure_kpa": kpa, "s": a, "x": b, "y": c} for a, b, c in zip(s, x, y, strict=True)
        ]
    pd.DataFrame(rows).to_csv(path, index=False, float_format="%.7g")


def runs(entry: dict[str, Any], folder: Path) -> Iterator[tuple[str, Run]]:
    """The runs of a scene: its own motion, at draft where it says so, and the other motion.

    With PIV where the entry says so; `piv = "own"`: of its own motion at smoke alone.
    """
    coupled, piv = entry.get("coupled", True), entry.get("piv", False)
    own = "coupled" if coupled else "prescribed"
    wanted = [(own, LEVEL, coupled, bool(piv))]
    if coupled and not entry.get("alone", False):
        wanted.append(("prescribed", LEVEL, False, piv is True))
    if entry.get("draft", False):
        wanted.append((f"{own}, draft", "draft", coupled, piv is True))
    for name, level, moved, filmed in wanted:
        yield name + ", PIV=0" * (not filmed), open_moved(folder, level, moved, filmed)


def made(entry: dict[str, Any], folder: Path) -> Iterator[tuple[str, Outcome]]:
    """Make what is missing of a scene, and what is found. What fails is an outcome, too."""
    if not (folder / "scene.toml").exists():
        new(entry, folder)
    machine = Machine()
    try:
        if not entry.get("curves"):
            analysis = open_moved(folder, LEVEL, None)
            if not (folder / "kinematics" / "states.h5").exists():
                from pipeline.structure.fea_stage import run as analyse

                analyse(analysis.scene, quiet=True)
    except (ValueError, RuntimeError, OSError) as error:
        yield "analysis", Outcome({}, f"{error}")
        return
    for name, run in runs(entry, folder):
        result = run.out / "park.json"
        predicted = of_page(run, recorded=False)
        try:
            make(run, "report", machine, quiet=True)
            values = _read(result, run) or checks(run)
            write_text(result, json.dumps(values | {"digest": run.digest("report")}) + "\n")
            records = [read_record(run.out, stage.name) for stage in STAGES]
            spent = sum(record["cpu_time"] for record in records if record)
            about = {"cpu_s": spent, "of_predicted": spent / predicted, "commit": commit()}
            yield name, Outcome(values | about, "")
        except (ValueError, RuntimeError, OSError) as error:
            yield name, Outcome({}, f"{error}")


def _read(result: Path, run: Run) -> dict[str, Any]:
    """What was found before of the same report; nothing of another."""
    values = json.loads(result.read_text()) if result.exists() else {}
    return (
        {k: v for k, v in values.items() if k in LIMITS}
        if (values.get("digest") == run.digest("report"))
        else {}
    )


def rows(entries: list[dict[str, Any]], folder: Path) -> pd.DataFrame:
    """The table of what has been made."""
    heads = ["scene", "motion", *(f"{x.about} (≤ {x.most:g})" for x in LIMITS.values()), "CPU s"]
    lines = []
    for entry in entries:
        for name, outcome in _outcomes(folder / entry["name"]).items():
            cells = [_cell(outcome, check) for check in LIMITS]
            if outcome.ended:
                cells = [f"no page: {outcome.ended}", *[""] * (len(LIMITS) - 1)]
            spent = outcome.values.get("cpu_s")
            lines.append([entry["name"], name, *cells, "" if spent is None else f"{spent:.0f}"])
    return pd.DataFrame(lines, columns=heads)


def page(entries: list[dict[str, Any]], folder: Path) -> str:
    """The page about the table, as Markdown."""
    about = [f"- {x.about}, at most {x.most:g}: {x.reason}." for x in LIMITS.values()]
    about += [""] + [
        f"- **{e['name']}**: {e['length']} × {e['width']}, {e['about']}."
        for e in entries
        if _outcomes(folder / e["name"])
    ]
    table = ["```{csv-table}", f":file: {CSV.name}", ":header-rows: 1", "```"]
    runs = [run for e in entries for run in _outcomes(folder / e["name"]).values()]
    passed = sum(not run.failed() for run in runs)
    made = (
        f"{passed} of {len(runs)} runs pass all checks. The runs took {_of_machine(folder):.2f} of"
        " the predicted CPU time in the median; the table's costs are over that. Code of commit"
        f" {', '.join(sorted({*_values(folder, 'commit')}))}."
    )
    return "\n".join([_HEAD, *about, "", *table, "", made, "", *_drawn(folder)])


def _drawn(folder: Path) -> list[str]:
    """The scenes that were drawn: how many held, and what failed of the others."""
    made = {
        path.parent.name: _outcomes(path.parent) for path in folder.glob("drawn_*/outcomes.json")
    }
    if not made:
        return []
    seeds = sorted({name.split("_")[1] for name in made})
    held = [n for n, runs in made.items() if runs and not any(x.failed() for x in runs.values())]
    lines = [
        "## Scenes that were drawn after the code",
        "",
        f"`python -m docs.evidence.park --new SEED` draws twelve further scenes and runs each in"
        f" its own motion with PIV=0. Of the {len(made)} that were made of seed"
        f" {', '.join(seeds)}, {len(held)} passed all checks. The others:",
        "",
        "| scene | fails |",
        "|---|---|",
    ]
    entries = [entry for seed in seeds for entry in drawn(int(seed)) if entry["name"] in made]
    for entry in entries:
        if entry["name"] in held:
            continue
        fails = [
            f"{LIMITS[check].about if check in LIMITS else one.ended}"
            + (f": {_cell(one, check)}" if check in LIMITS else "")
            for one in made[entry["name"]].values()
            for check in one.failed()
        ]
        about = (
            f"{entry['length']} × {entry['width']}, {entry['about']}, {entry['pressure']['kind']}"
        )
        lines.append(f"| {entry['name']}: {about} | {'; '.join(fails) or 'not run'} |")
    return [*lines, ""]


def _cell(outcome: Outcome, name: str) -> str:
    value = outcome.values.get(name)
    text = value if isinstance(value, str) else "missing" if value is None else f"{value:.3g}"
    return f"**{text}**" if name in outcome.failed() else text


def _outcomes(folder: Path) -> dict[str, Outcome]:
    path = folder / "outcomes.json"
    found = json.loads(path.read_text()) if path.exists() else {}
    outcomes = {name: Outcome(**entry) for name, entry in found.items()}
    machine = _of_machine(folder.parent)
    for outcome in outcomes.values():
        if share := outcome.values.get("of_predicted"):
            outcome.values["cost"] = max(share / machine, machine / share)
    return outcomes


def _values(folder: Path, name: str) -> list[Any]:
    """A value of all runs in a folder of scenes."""
    kept = [json.loads(path.read_text()) for path in folder.glob("*/outcomes.json")]
    every = [entry["values"] for runs in kept for entry in runs.values()]
    return [values[name] for values in every if name in values]


def _of_machine(folder: Path) -> float:
    """CPU time over the predicted: the median of the runs in a folder of scenes."""
    return float(np.median(_values(folder, "of_predicted") or [1.0]))


def main() -> int:
    """Run the scenes, print each outcome, write the page; 1 where a check fails."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", help="scenes of the table; none: all")
    parser.add_argument("--new", type=int, help="seed: of twelve further scenes")
    options = parser.parse_args()
    table = tomllib.loads(TABLE.read_text(encoding="utf-8"))["scene"]
    entries = table if options.new is None else drawn(options.new)
    if unknown := {*options.names} - {entry["name"] for entry in entries}:
        parser.error(f"{unknown.pop()} is no scene of the park")
    entries = [entry for entry in entries if entry["name"] in (options.names or [entry["name"]])]
    for entry in entries:
        folder = FOLDER / entry["name"]
        found: dict[str, Any] = {}
        for name, outcome in made(entry, folder):
            found[name] = {"values": outcome.values, "ended": outcome.ended}
            write_text(folder / "outcomes.json", json.dumps(found, indent=1) + "\n")
            wrong = [check for check in outcome.failed() if check != "cost"]  # known at the end
            more = f" ({outcome.ended})" if outcome.ended else ""
            print(f"{entry['name']}, {name}: {', '.join(wrong) or 'passes'}{more}", flush=True)
    write_text(PAGE, page(table, FOLDER))
    write_table(CSV, rows(table, FOLDER))
    runs = [run for entry in entries for run in _outcomes(FOLDER / entry["name"]).values()]
    failed = sum(bool(run.failed()) for run in runs)
    print(f"{len(runs) - failed} of {len(runs)} runs pass all checks; costs: {PAGE}")
    return int(failed > 0)
