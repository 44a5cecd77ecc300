"""General helpers for files, processes and errors, shared by all packages."""

__version__ = "0.1.0"
