"""docs/reference/licences.csv names every locked package; its licences go with the project's."""

import csv
import importlib.metadata
import re
import tomllib
from datetime import date, timedelta

import pytest

from tests.conftest import ROOT

LOCKS = {"requirements": "requirements.lock"}
_OTHERS = ("dev", "study", "docs", "audit", "release")
LOCKS |= {name: f"requirements-{name}.lock" for name in _OTHERS}
# go with GPL-3.0-or-later; the FSF's list of licences
GOOD = {"0BSD", "Apache-2.0", "BSD-2-Clause", "BSD-3-Clause", "CC0-1.0", "MIT", "MIT-CMU"} | {
    *("GPL-2.0-or-later", "GPL-3.0-or-later", "LGPL-2.1-or-later", "LLVM-exception", "MPL-2.0"),
    *("PSF-2.0", "Zlib", "public domain"),
}


def table():
    with (ROOT / "docs" / "reference" / "licences.csv").open() as file:
        rows = list(csv.DictReader(file))
    return {row["package"]: (row["licence"], row["lock"].split(" and ")) for row in rows}


def test_every_locked_package_has_a_row_and_no_other():
    for short, lock in LOCKS.items():
        locked = set(re.findall(r"(?m)^([A-Za-z0-9_.-]+)==", (ROOT / lock).read_text()))
        assert {name for name, (_, locks) in table().items() if short in locks} == locked


# finished or small packages that others need, whose last release is older than _OLDEST
OLD = {
    "colorama": "for Windows alone, by tools that run elsewhere",
    "connection-pool": "of Snakemake's throttling; two hundred lines without network",
    "defusedxml": "of pip-audit; refuses what makes XML dangerous, and is complete",
    "humanfriendly": "of Snakemake's options; parses sizes",
    "mdurl": "of Markdown's parser; complete",
    "sortedcontainers": "of Hypothesis and pip-audit; complete, without dependencies",
}
_OLDEST = timedelta(days=4 * 365.25)


def test_every_package_was_released_within_four_years_or_is_named_with_a_reason():
    """Against the newest release in the table, so that the test does not fail by itself."""
    with (ROOT / "docs" / "reference" / "licences.csv").open() as file:
        dates = {r["package"]: date.fromisoformat(r["released"]) for r in csv.DictReader(file)}
    newest = max(dates.values())
    assert {name for name, day in dates.items() if newest - day > _OLDEST} == set(OLD)


def test_users_get_no_tools_of_developers():
    locked = (ROOT / "requirements.lock").read_text()
    groups = tomllib.loads((ROOT / "pyproject.toml").read_text())["dependency-groups"]
    for name in (*groups["dev"], "nose", "py", "pymraw"):
        assert f"\n{name}==" not in locked


def test_every_package_is_locked_with_its_hash():
    for lock in LOCKS.values():
        packages = re.split(r"(?m)^(?=[A-Za-z0-9_.-]+==)", (ROOT / lock).read_text())[1:]
        assert all("--hash=sha256:" in package for package in packages)
    for path in ("Makefile", "softfinger/setup.sh", ".ci/release"):
        text = (ROOT / path).read_text().replace("\\\n", " ")
        # what a release installs without hashes is what it has built
        installs = [line for line in text.splitlines() if "pip install" in line]
        installs = [line for line in installs if '"$file"' not in line]
        assert installs
        assert all("--require-hashes" in line for line in installs)


@pytest.mark.parametrize("name", sorted(table()))
def test_a_licence_goes_with_the_project_s_own(name):
    licence = table()[name][0]
    if licence == "GPL-3.0-only":
        groups = tomllib.loads((ROOT / "pyproject.toml").read_text())["dependency-groups"]
        assert name in groups["dev"]  # used by tests, no part of what is given away
        return
    parts = {part.strip("() ") for part in re.split(" AND | OR | WITH ", licence)}
    assert parts <= GOOD
    try:
        declared = importlib.metadata.metadata(name).get("License-Expression")
    except importlib.metadata.PackageNotFoundError:
        return  # of another system or environment
    assert declared in (None, licence)
