"""The refusal that all parts of the alignment share."""

from observer.errors import TruthError


class NotObservable(TruthError):
    """The recordings do not determine what is asked for; the sentence says what would."""
