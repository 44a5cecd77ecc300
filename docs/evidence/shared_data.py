"""Public recordings and fields of other projects, where this machine has them."""

import os
from pathlib import Path


def shared_data() -> Path | None:
    """The folder of shared data beside the repository, or as SHARED_DATA says."""
    if "SHARED_DATA" in os.environ:
        return Path(os.environ["SHARED_DATA"])
    for parent in Path(__file__).resolve().parents:
        if (parent / "shared" / "data").is_dir():
            return parent / "shared" / "data"
    return None
