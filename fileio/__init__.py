"""Files, errors and command lines that all packages share."""
