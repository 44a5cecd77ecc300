"""Failures as one sentence, for every command line."""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import Any

from fileio.errors import StageError, sentence


def guarded(stage: str, action: Callable[[], Any]) -> None:
    """Run `action`; a foreseeable failure becomes one sentence and exit code 2, an interrupt 130."""
    try:
        action()
    except StageError as error:
        print(f"{stage}: {error}", file=sys.stderr)
        sys.exit(2)
    except Exception as error:
        message = sentence(error) if isinstance(error, OSError | RuntimeError | MemoryError) else None
        if message is None:
            raise
        print(f"{stage}: {message}", file=sys.stderr)
        sys.exit(2)
    except KeyboardInterrupt:
        print(f"{stage}: interrupted; run make again to go on", file=sys.stderr)
        sys.exit(130)
