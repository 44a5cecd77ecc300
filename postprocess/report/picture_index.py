"""The report's pictures as they are made, and their index."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from postprocess.draw.style import save


class Album:
    """Writes pictures into a folder and remembers section, alternative text and caption of each."""

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
        """Save a figure (None: the file is there already) and list it in a section."""
        if figure is not None:
            save(figure, self.folder / name)
        entry = {"file": name, "section": section, "alt": alt, "caption": caption}
        self.entries.append(entry | more)
