"""The report's pictures as they are made, and their index."""

from pathlib import Path
from typing import Any

from matplotlib.figure import Figure
from numpy import ndarray

from postprocess.draw.animation import write_picture
from postprocess.draw.style import save

_QUALITY = 90  # of 100
# as Pillow takes them
_PRINTED: dict[str, dict[str, Any]] = {
    ".pdf": {"resolution": 300.0, "quality": 95},
    ".png": {"dpi": (300, 300)},
}


class Album:
    """Writes pictures into a folder and remembers section, alternative text and caption of each."""

    dpi = 190.0  # of pictures that are drawn by pixels

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.entries: list[dict[str, Any]] = []

    def add(
        self,
        figure: Figure | ndarray | None,
        name: str,
        section: str,
        alt: str,
        caption: str = "",
        **more: Any,
    ) -> None:
        """Save a figure or an image (None: the file is there already) and list it in a section.

        A figure over time is listed with its axis, so that the page can show an instant in it.
        """
        if isinstance(figure, ndarray):
            write_picture(figure, self.folder / name, quality=_QUALITY)
        elif figure is not None:
            save(figure, self.folder / name)
            more |= time_axis(figure)
        entry = {"file": name, "section": section, "alt": alt, "caption": caption}
        self.entries.append(entry | more)


class PrintAlbum(Album):
    """The pictures for print: each as PDF and as PNG, 300 dpi."""

    dpi = 300.0

    def add(self, figure: Figure | ndarray | None, name: str, *_: str, **more: Any) -> None:
        """Save a figure or an image in both formats."""
        for suffix, resolution in _PRINTED.items():
            path = (self.folder / name).with_suffix(suffix)
            if isinstance(figure, ndarray):
                write_picture(figure, path, **resolution)
            elif figure is not None:
                save(figure, path, dpi=self.dpi)


def time_axis(figure: Figure) -> dict[str, Any]:
    """`axis`: left and right end in parts of the width, and their times (s); empty without one.

    Then the space above and below all axes, in parts of the height.
    """
    axes = [ax for ax in figure.axes if ax.get_label() != "<colorbar>"]
    over = [ax for ax in axes if ax.get_xlabel() == "time, s"]
    if not over or len({(ax.get_xlim(), ax.get_position().x0) for ax in axes}) > 1:
        return {}
    places = [ax.get_position() for ax in axes]
    room = 1 - max(p.y1 for p in places), min(p.y0 for p in places)
    return {"axis": [places[0].x0, places[0].x1, *map(float, over[0].get_xlim()), *room]}
