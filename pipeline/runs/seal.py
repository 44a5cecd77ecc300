"""The seal of a record: this clone made its files.

OpenFOAM runs what a case says. A case that came with a stranger's folder is therefore made again,
whatever its record says. The key lies in the clone alone; a folder that is copied to another clone
keeps its results, and a solver that was interrupted there starts again.
"""

import hmac
import json
import os
import secrets
from functools import cache
from pathlib import Path
from typing import Any

from piv.files.atomic import write_text
from piv.files.record import read_record, record_path

KEY = Path(__file__).resolve().parents[2] / ".seal"


@cache
def own_key() -> bytes:
    """Return the clone's key, made at its first use; or one of the process alone."""
    try:
        with os.fdopen(os.open(KEY, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o600), "wb") as file:
            file.write(secrets.token_bytes(32))
    except FileExistsError:
        pass
    except OSError:
        return secrets.token_bytes(32)
    return KEY.read_bytes()


def _seal(record: dict[str, Any]) -> str:
    content = {name: value for name, value in record.items() if name != "seal"}
    return hmac.new(own_key(), json.dumps(content, sort_keys=True).encode(), "sha256").hexdigest()


def seal(out: Path, stage: str) -> None:
    """Seal the record of a stage of the run in `out`."""
    record = read_record(out, stage)
    assert record is not None
    write_text(
        record_path(out, stage), json.dumps(record | {"seal": _seal(record)}, indent=1) + "\n"
    )


def is_sealed(record: dict[str, Any]) -> bool:
    """Whether this clone has made the files of a record."""
    return hmac.compare_digest(str(record.get("seal", "")), _seal(record))
