"""The commands of `piv` in a test's own process."""

from piv.__main__ import main


def piv(*words) -> int:
    """Exit code of `piv` with these words."""
    try:
        return main([str(word) for word in words])
    except SystemExit as end:  # of an argument that is none
        return int(end.code or 0)


def made(*words) -> None:
    """Run `piv` quietly; it must succeed."""
    assert piv(*words, "--quiet") == 0
