"""The one exception of the project's own."""


class StageError(Exception):
    """A stage cannot go on; the message is one sentence with the cause and the remedy."""
