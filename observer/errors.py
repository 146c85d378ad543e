"""The library's errors: one root, and one class for each way a caller can react.

Every message is one sentence that names what is wrong and what would be right.
Only the command line exits on them, and only the web layer maps them to HTTP.
"""


class DynamicObserverError(Exception):
    """Root of every error that this library raises on purpose."""

    def __str__(self) -> str:
        """Return the message on one line: text quoted from a file or path may contain newlines."""
        text = super().__str__()
        if text.isprintable():
            return text
        return "".join(each if each.isprintable() else repr(each)[1:-1] for each in text)


class InputError(DynamicObserverError):
    """Refusal of input (a path, a file, a name, a value) that cannot be used as it is."""


class SourceError(InputError):
    """A source of stereo frames cannot be opened or read."""


class CalibrationError(InputError):
    """A calibration is missing, unreadable or physically impossible."""


class ScenarioError(InputError):
    """A simulated scenario is unknown or inconsistent."""


class TruthError(InputError):
    """A file of true poses cannot be read or does not match the run."""


class NotObservable(TruthError):
    """The recordings do not determine the requested value; the sentence says what would help."""


class ParameterError(InputError):
    """Parameter values were refused; nothing was changed.

    Attributes:
        problems: one entry per refused field: dotted name -> sentence that states the range.
    """

    def __init__(self, problems: dict[str, str]) -> None:
        self.problems = dict(problems)
        super().__init__("; ".join(f"{name[:60]}: {text}" for name, text in problems.items()))
