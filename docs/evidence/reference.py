"""Write docs/reference: the keys of scene.toml and dpiv.toml, and the formats of files.

python -m docs.evidence.reference
"""

import csv
import io
import sys
from collections.abc import Iterable
from importlib import import_module
from pathlib import Path
from pkgutil import iter_modules

import pipeline.formats
import piv.formats
from docs.evidence.small_scene import ROOT
from pipeline.formats import records
from pipeline.scene.key_reference import Key
from pipeline.scene.read_toml import read_layers
from piv.files.atomic import write_text
from piv.files.command import guarded
from piv.files.errors import StageError
from piv.files.json_text import flat
from piv.files.schema import Schema, Table
from piv.formats import vortex_table
from postprocess.lab.dpiv_toml import KEYS
from softfinger.scene_reference import keys

FOLDER = ROOT / "docs" / "reference"
_TABLES = {
    "run/forces.csv": records.FORCES,
    "run/power.csv": records.POWER,
    "run/power_terms.csv": records.POWER_TERMS,
    "run/through_flow.csv": records.THROUGH_FLOW,
    "run/history.csv": records.HISTORY,
    "mesh_quality.csv": records.MESH_QUALITY,
}
_OF_A_KEY = ("key", "type", "unit", "default", "meaning")


def schemas() -> list[Schema]:
    """All formats that the modules of the two folders of formats declare, by name."""
    modules = (
        import_module(f"{package.__name__}.{module.name}")
        for package in (piv.formats, pipeline.formats)
        for module in iter_modules(package.__path__)
    )
    declared = (value for module in modules for value in vars(module).values())
    found = {value.format: value for value in declared if isinstance(value, Schema)}
    return [found[name] for name in sorted(found)]


def formats() -> str:
    """The variables and attributes of every format; StageError where one is not described."""
    page = (FOLDER.parent / "formats.md").read_text(encoding="utf-8")
    if new := [schema.format for schema in schemas() if f"| {schema.format} |" not in page]:
        raise StageError(f"docs/formats.md: add a row for the format {new[0]}")
    known = [*_TABLES.values()]
    if new := [n for n, t in vars(records).items() if isinstance(t, Table) and t not in known]:
        raise StageError(
            f"docs/evidence/reference.py: name the file of {new[0]} in _TABLES, then run python -m"
            " docs.evidence.reference"
        )
    if new := [file for file in _TABLES if f"`{Path(file).name}`" not in page]:
        raise StageError(f"docs/formats.md: describe {new[0]}")
    rows = [("vortices_*.csv", ", ".join(vortex_table.COLUMNS), "columns", "SI", "")]
    for schema in schemas():
        declared = [("", v) for v in schema.root] + [("<group>/", v) for v in schema.group]
        for place, v in declared:
            dims, meaning = "attribute" if v.dims == "-" else v.dims, "optional: " * v.optional
            name = f"{schema.format} {schema.version}"
            rows.append((name, place + v.name, dims, v.units, meaning + v.meaning))
    rows += [(file, table.header, "columns", "SI", "") for file, table in _TABLES.items()]
    return _csv(("format", "name", "dimensions", "unit", "meaning"), rows)


def scene_keys() -> str:
    """The keys of a scene, and the levels of single_finger that set another value."""
    levels: dict[str, str] = {}
    for layer in read_layers(ROOT / "cases" / "single_finger" / "scene.toml"):
        for level, table in layer.levels.items():
            for name in flat(table):
                levels[name] = ", ".join(filter(None, (levels.get(name), level)))
    rows = ((*_cells(key), levels.get(key.name, "")) for key in keys())
    return _csv((*_OF_A_KEY, "levels"), rows)


def dpiv_keys() -> str:
    """The keys of dpiv.toml."""
    return _csv(_OF_A_KEY, map(_cells, KEYS))


def _cells(key: Key) -> tuple[str, ...]:
    return key.name, key.type, key.unit, key.default, key.meaning


def _csv(header: tuple[str, ...], rows: Iterable[tuple[str, ...]]) -> str:
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows([header, *rows])
    return text.getvalue()


PAGES = {"formats.csv": formats, "scene_keys.csv": scene_keys, "dpiv_keys.csv": dpiv_keys}


def main() -> None:
    """Write all of them."""
    for name, text in PAGES.items():
        write_text(Path(FOLDER / name), text())


if __name__ == "__main__":
    sys.exit(guarded("reference", main))
