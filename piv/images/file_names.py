"""What the names of image files state: their order, their pairs, and which of them are missing."""

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from piv.files.json_text import natural_key

PAIRINGS = ("1-2,2-3", "1-2,3-4")
MOST_GAPS = 0.4  # of the neighbours: couples 1, 2, 11, 12, 21, 22 have as many, and lack none
MOST_MISSING = 0.5  # of the files: more are two recordings in one folder

_EXPOSURE = re.compile(r"(.*(?:[_\-. ]|\d))(L?[ABab])|(.*[_\-])([012])")
_PARTNERS = ({"A", "B"}, {"LA", "LB"}, {"a", "b"}, {"0", "1"}, {"1", "2"})


def _exposure_of(path: Path) -> tuple[str, str] | None:
    """Name of the pair and label of the exposure: im_07_A -> "im_07_", "A"; None without one."""
    match = _EXPOSURE.fullmatch(path.stem)
    return None if match is None else (match[1] or match[3], match[2] or match[4])


def in_couples(paths: Sequence[Path]) -> list[Path]:
    """Files in natural order, the exposures of a pair side by side where all names have a label."""
    labels = {p: _exposure_of(p) for p in paths}
    if all(labels.values()):
        return sorted(paths, key=lambda p: (natural_key((labels[p] or "")[0]), labels[p]))
    return sorted(paths, key=natural_key)


def pairing_by_name(paths: Sequence[Path]) -> tuple[str | None, str]:
    """The pairing that names such as im_07_A, im_07_B state, else "1-2,2-3".

    None with a sentence where the names speak of two exposures and one of a pair is not there.
    """
    neighbours, couples = PAIRINGS
    found = [_exposure_of(p) for p in paths]
    names = [f for f in found if f is not None]
    labels = {label for _, label in names}
    partners = next((p for p in _PARTNERS if labels <= p), None)
    if len(names) < len(paths) or partners is None or len({name for name, _ in names}) < 2:
        return neighbours, ""
    number = {(path.parent, name) for path, (name, _) in zip(paths, names, strict=True)}
    if len(labels) == 2 and 2 * len(number) == len(paths):
        first, second = sorted(partners)
        if all(
            a[0] == b[0] and (a[1], b[1]) == (first, second)
            for a, b in zip(names[::2], names[1::2], strict=True)
        ):
            return couples, ""
        return None, (
            f"{paths[0]} ...: the names are of pairs, but not in the order of pairs; give the "
            "folder or a pattern, or `pairing`"
        )
    for path, (name, label) in zip(paths, names, strict=True):
        for other in partners - {label}:
            partner = path.with_name(f"{name}{other}{path.suffix}")
            if partner in paths or (len(labels) == 1 and not partner.exists()):
                continue
            return None, (
                f"{path}: the name is of one exposure of a pair, and {partner.name} is not among "
                "the images; add it (a pattern that takes both, such as "
                f"'*{path.suffix}'), or say with `pairing` how they go together"
            )
    return neighbours, ""


def with_missing(paths: Sequence[Path], pairing: str | None) -> list[Path]:
    """The files, and between them the names of those that the numbers in their names lack.

    Numbers that are even but for gaps count frames, or the pairs of `pairing`. Numbers of couples,
    or times, have no step by which most neighbours differ. ValueError where too many are missing.
    """
    group = 2 if pairing == PAIRINGS[1] else 1
    names = [re.split(r"(\d+)", path.name) for path in paths[::group]]
    if len(names) < 3 or len({len(name) for name in names}) > 1:
        return list(paths)
    varying = [k for k in range(len(names[0])) if len({name[k] for name in names}) > 1]
    if len(varying) != 1 or varying[0] % 2 == 0 or len({path.parent for path in paths}) > 1:
        return list(paths)
    (place,) = varying
    numbers = np.array([int(name[place]) for name in names], object)
    apart = np.diff(numbers)
    step = min(apart)
    gaps = np.flatnonzero(apart != step)
    if step <= 0 or not 0 < len(gaps) < MOST_GAPS * len(apart) or any(apart % step):
        return list(paths)
    if sum(apart) // step - len(apart) > MOST_MISSING * len(names):
        if group == 2:  # each pair is whole
            return list(paths)
        widest = int(np.argmax(apart))
        before, after = paths[widest], paths[widest + 1]
        raise ValueError(
            f"{before}: {apart[widest] // step - 1} are missing between it and {after.name}; add"
            " them, or give what is before and after them as recordings of their own"
        )
    whole: list[Path] = []
    for k, more in enumerate([*apart, step]):
        files = paths[group * k : group * (k + 1)]
        whole += files
        for number in range(numbers[k] + step, numbers[k] + more, step):
            for path in files:
                parts = re.split(r"(\d+)", path.name)
                parts[place] = f"{number:0{len(parts[place])}d}"
                whole.append(path.with_name("".join(parts)))
    return whole
