"""The wheel is the package `piv` alone: the shared package `fileio` lies in it as `piv._fileio`.

Its own name, or those of the pipeline, which runs in a clone (make setup), could clash with others
in a user's environment.
"""

from __future__ import annotations

import re
import shutil
from pathlib import Path
from tempfile import mkdtemp
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface


class CustomBuildHook(BuildHookInterface):
    """Copies of both packages with the one name in place of the other."""

    copies: Path | None = None

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Name the copies as what the wheel holds; an editable installation uses the folders."""
        if version == "editable":
            return
        self.copies = copies = Path(mkdtemp(prefix="piv-wheel-"))
        for package, name in (("piv", "piv"), ("fileio", "piv/_fileio")):
            for path in Path(self.root, package).rglob("*"):
                if not path.is_file() or "__pycache__" in path.parts:
                    continue
                target = f"{name}/{path.relative_to(Path(self.root, package)).as_posix()}"
                copy = copies / target
                copy.parent.mkdir(parents=True, exist_ok=True)
                content = path.read_bytes()
                if path.suffix == ".py":
                    content = re.sub(rb"\bfileio(?=\.| import)", b"piv._fileio", content)
                copy.write_bytes(content)
                build_data["force_include"][str(copy)] = target

    def finalize(self, version: str, build_data: dict[str, Any], artifact_path: str) -> None:
        """Remove the copies."""
        if self.copies is not None:
            shutil.rmtree(self.copies)
