"""The one writer of CSV tables."""

import json
from pathlib import Path
from typing import Any

import pandas as pd

from piv.files.atomic import write_text


def write_table(path: Path, table: pd.DataFrame, head: dict[str, Any] | None = None) -> None:
    """Write a table as CSV whole or not at all; `head` becomes a first line `# {JSON}`."""
    first = f"# {json.dumps(head)}\n" if head else ""
    write_text(path, first + table.to_csv(index=False))
