"""Files, errors and command lines that all packages share."""

__version__ = "0.1.0"
