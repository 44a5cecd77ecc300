"""The report's pictures as they are made, and their index."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from postprocess.draw.style import save


class Album:
    """Pictures as they are made: writes each file and remembers its title, alternative text and caption."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.entries: list[dict[str, Any]] = []

    def add(
        self,
        figure: Figure | None,
        name: str,
        section: str,
        alt: str,
        caption: str = "",
        **more: Any,
    ) -> None:
        """Save a figure (None: the file is there already) and list it under a section of the report."""
        if figure is not None:
            save(figure, self.folder / name)
        self.entries.append(
            {"file": name, "section": section, "alt": alt, "caption": caption, **more}
        )
