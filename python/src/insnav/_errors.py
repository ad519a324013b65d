"""What this package raises and warns of."""

from __future__ import annotations


class InsnavError(ValueError):
    """Data, settings or a log that cannot be used as they are.

    Attributes
    ----------
    code : str
        A short name for programs, such as ``"unknown_config_key"``.
    message : str
        What is wrong, and where.
    remedy : str
        What to do about it; may be empty.
    """

    def __init__(self, message: str, code: str = "error", remedy: str = "") -> None:
        # All of them, so that pickling makes the same again.
        super().__init__(message, code, remedy)
        self.message = message
        self.code = code
        self.remedy = remedy

    def __str__(self) -> str:
        return f"{self.message}; {self.remedy}" if self.remedy else self.message


class InsnavWarning(UserWarning):
    """Data or settings that look wrong, but can be used; the text ends with a remedy."""
