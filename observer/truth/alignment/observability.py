"""The error that all parts of the alignment raise."""

from observer.errors import TruthError


class NotObservable(TruthError):
    """The recordings do not determine the requested value; the sentence says what would help."""
