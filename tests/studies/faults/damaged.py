"""The inputs of every stage of a finished run, each damaged in twelve ways: all must be refused."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

from fileio.errors import sentence
from fileio.record import record_path
from pipeline.runs.make import Machine, make_stage
from pipeline.runs.run import Run
from pipeline.runs.stages import Stage
from tests.damage import WAYS, damage
from tests.studies.faults.kill import Row


def _inputs_of(run: Run, stage: Stage) -> list[Path]:
    """The files that a stage reads of the stages before it."""
    if "run" in stage.inputs:  # they read the samples alone
        name = {"sheet": "sheetSurface", "loads": "fingerSurface"}[stage.name]
        return [max(run.out.glob(f"case/interval_0/postProcessing/{name}/*/*.vtk"))]
    files = [run.path(name) for name in run.inputs(stage)]
    if stage.name == "run":
        files += sorted((run.out / "case").glob("interval_*/constant/polyMesh/*"))
    return files


def _answer(run: Run, stage: Stage, path: Path, way: str) -> tuple[bool, str]:
    """Whether a stage refuses a damaged input in one sentence with its name, and the sentence."""
    kept = {
        file: (file.read_bytes(), file.stat()) for file in (path, record_path(run.out, stage.name))
    }
    record_path(run.out, stage.name).unlink()
    try:
        damage(path, way)
        make_stage(run, stage.name, Machine(), quiet=True)
    except Exception as error:
        text = sentence(error)
        return text is not None and "\n" not in text and str(path) in text, text or repr(error)
    finally:
        for file, (content, state) in kept.items():
            file.write_bytes(content)
            os.utime(file, ns=(state.st_atime_ns, state.st_mtime_ns))
    return False, "it was used"


def damaged_inputs(run: Run) -> Iterator[Row]:
    """Stage, input, ways, how many of them are refused, and the first fault or else a sentence."""
    for stage in run.stages:
        for path in _inputs_of(run, stage):
            answers = {way: _answer(run, stage, path, way) for way in WAYS}
            wrong = [f"{way}: {text}" for way, (good, text) in answers.items() if not good]
            sentences = [*wrong, *(text for _, text in answers.values())]
            yield {
                "stage": stage.name, "input": str(path.relative_to(run.out)), "ways": len(WAYS),
                "refused": len(WAYS) - len(wrong),
                "sentence": sentences[0].replace(f"{run.out}/", ""),
            }  # fmt: skip
