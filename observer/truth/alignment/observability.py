"""Refusal that all parts of the alignment share."""

from observer.errors import TruthError


class NotObservable(TruthError):
    """Recordings that do not determine what is asked for; the sentence says what would."""
