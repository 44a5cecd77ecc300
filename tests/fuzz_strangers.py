"""Folders and tables of strangers: records, links, names and cells that would do harm.

A table is read with its true values, or refused in one sentence; a folder is made, or refused so,
and no file outside of it changes. The same seed gives the same inputs.
"""

import json
import os
import random
import shutil
from collections import Counter
from pathlib import Path

import numpy as np

from pipeline.runs.run import open_run
from piv.files.atomic import sha256
from piv.files.errors import StageError, sentence
from piv.files.record import forget, record_path
from piv.formats.user_tables import read_history
from softfinger.make import Machine, make
from tests.conftest import write_scene

LONGEST = 700  # characters of a sentence
NAMES = ("plain", "a b", "o'brien", 'q"q', "a$(touch made)b", "a;touch made", "größe", "-rf", "a:b")


def tree(folder: Path) -> dict[str, str]:
    """Name and content, or target, of all that a folder holds."""
    return {
        str(path): os.readlink(path) if path.is_symlink() else sha256(path)
        for path in sorted(folder.rglob("*"))
        if path.is_symlink() or path.is_file()
    }


def check_sentence(error: BaseException) -> str:
    """AssertionError where a failure is no short sentence for the user."""
    text = sentence(error)
    assert text is not None, repr(error)
    assert "\n" not in text, text
    assert len(text) < LONGEST, text
    return text


def table(draw: random.Random) -> tuple[bytes, np.ndarray | None]:
    """A table t, p as it might be saved, and its values (row, 2) where it has them."""
    rows = draw.randrange(2, 30)
    values = np.column_stack(
        [np.arange(rows) * 0.013, [draw.uniform(0, 30000) for _ in range(rows)]]
    )
    values = np.round(values, 3)
    sign, decimal = draw.choice([",.", ";.", ";,", "\t.", "\t,"])
    thousands = draw.choice(["", "", "", "'", " ", "." if decimal == "," else ","])
    quoted, ms = draw.random() < 0.3 or thousands == sign, draw.random() < 0.3

    def cell(value: float, digits: int) -> str:
        text = (
            f"{value:,.{digits}f}".replace(",", "T").replace(".", decimal).replace("T", thousands)
        )
        return f'"{text}"' if quoted else text

    lines = [f"t{' [ms]' if ms else ''}{sign}p"] if ms or draw.random() < 0.8 else []
    lines += [cell(t * 1000 if ms else t, 3) + sign + cell(p, 3) for t, p in values]
    fault = draw.choice([None] * 6 + ["word", "cells", "order", "bytes", "half"])
    at = draw.randrange(1, len(lines)) if len(lines) > 1 else 0
    if fault == "word":
        lines[at] = draw.choice(["nan", "1e999", "#", "=cmd", "0x10", "\u0661"]) + sign + "1"
    elif fault == "cells":
        lines[at] += sign + "7" + sign + "8"
    elif fault == "order":
        lines.append(lines[at])
    text = draw.choice(["\n", "\r\n"]).join(lines) + "\n"
    content = text.encode(draw.choice(["utf-8", "utf-8", "utf-8-sig", "utf-16"]))
    if fault == "bytes":
        content = content[:20] + bytes(draw.randrange(256) for _ in range(8)) + content[20:]
    elif fault == "half":
        content = content[: draw.randrange(len(content))]
    return content, values if fault is None else None


def count_tables(count: int, first: int, folder: Path) -> Counter[str]:
    """Outcomes of drawn tables; AssertionError for wrong values, or no sentence."""
    outcomes: Counter[str] = Counter()
    path = folder / "p.csv"
    for seed in range(first, first + count):
        content, values = table(random.Random(seed))
        path.write_bytes(content)
        try:
            read = np.column_stack(read_history(path, "pressure", 2))
        except StageError as error:
            text = check_sentence(error)
            # a comma that may be either is all that a sound table is refused for
            assert values is None or "may be a decimal comma" in text, (content, text)
            outcomes["refused"] += 1
            continue
        if values is not None:
            np.testing.assert_allclose(read, values, rtol=1e-9, atol=1e-9, err_msg=str(content))
        outcomes["read"] += 1
    return outcomes


def _harm(draw: random.Random, out: Path, mine: Path) -> None:
    """Put one to three things that would do harm into a run's folder."""
    for _ in range(draw.randrange(1, 4)):
        kind = draw.choice(["name", "name", "link", "shape", "pipe", "dangling"])
        place = draw.choice(["log.txt", "case", "run", "made/mesh.json", "x/y", "planform.h5"])
        path, record = out / place, record_path(out, "kinematics")
        if kind in ("link", "dangling", "pipe") and not os.path.lexists(path):
            path.parent.mkdir(parents=True, exist_ok=True)
            targets = [mine, mine / "a.txt", os.path.relpath(mine / "a.txt", path.parent)]
            if kind == "pipe":
                os.mkfifo(path)
            else:
                path.symlink_to(draw.choice(targets) if kind == "link" else "nowhere")
        elif record.is_file():
            try:
                content = json.loads(record.read_text())
                state = {"bytes": 4, "time_ns": 0, "sha256": "0" * 64}
                if kind == "name":
                    relative = os.path.relpath(mine / "a.txt", out)
                    name = draw.choice(
                        [str(mine / "a.txt"), relative, "x/../" + relative, "x/y/a.txt"]
                    )
                    content["outputs"][name] = state
                else:
                    key = draw.choice(list(content))
                    content[key] = draw.choice([None, [], {}, "x", -1, 10**400, {"a": []}])
            except (ValueError, TypeError, AttributeError):
                continue
            record.write_text(json.dumps(content))


def count_folders(count: int, first: int, folder: Path) -> Counter[str]:
    """Outcomes of making drawn folders; AssertionError where a file outside changes."""
    outcomes: Counter[str] = Counter()
    template, mine = write_scene(folder / "template"), folder / "mine"
    make(open_run(template.folder, "tiny"), "kinematics", Machine(), quiet=True)
    mine.mkdir()
    for name in ("a.txt", "Makefile", "b.txt"):
        (mine / name).write_text("mine")
    for seed in range(first, first + count):
        draw = random.Random(seed)
        scene = folder / "strangers" / draw.choice(NAMES)
        shutil.copytree(template.folder, scene)
        out = scene / "out" / "tiny"
        if draw.random() < 0.3:  # to be taken over by the run of another folder
            out = out.rename(out.with_name("other"))
        if draw.random() < 0.15:
            shutil.rmtree(scene / "out")
            (scene / "out").symlink_to(draw.choice([str(mine), "../../mine", "nowhere"]))
        else:
            _harm(draw, out, mine)
        end = draw.choice([None, 0.1])
        before = tree(mine) | tree(template.folder)
        try:
            run = open_run(
                scene, "tiny", {"motion.end_time": end} if end else {}, scene / "out/tiny"
            )
            forget(run.out, "kinematics", draw.choice(["other", run.digest("kinematics")]))
            make(run, "kinematics", Machine(), quiet=True)
            outcomes["made"] += 1
        except Exception as error:
            check_sentence(error)
            outcomes["refused"] += 1
        assert tree(mine) | tree(template.folder) == before, (seed, scene)
        shutil.rmtree(folder / "strangers")
    return outcomes
