"""Settings by name, as dataclasses."""

from dataclasses import fields
from typing import Any

from piv.files.errors import suggestion


def build(settings: dict[str, Any], *kinds: Any, more: tuple[str, ...] = ()) -> list[Any]:
    """One dataclass of each of `kinds`, from its fields in `settings`.

    ValueError for a key that is neither a field nor in `more`, and for a wrong type.
    """
    names = [{field.name for field in fields(kind)} for kind in kinds]
    known = set(more).union(*names)
    if unknown := sorted(set(settings) - known):
        near = suggestion(unknown[0], known) or f"; known are {', '.join(sorted(known))}"
        raise ValueError(f"unknown setting {unknown[0]!r}{near}")
    try:
        return [
            kind(**{key: settings[key] for key in own & settings.keys()})
            for kind, own in zip(kinds, names, strict=True)
        ]
    except TypeError as error:
        raise ValueError(f"a setting has the wrong type: {error}") from error
