"""The refusal that all parts of the alignment share."""

from observer.errors import TruthError


class NotObservable(TruthError):
    """What was recorded does not determine what is asked for; the sentence says what would."""
