"""What this package raises and warns of."""

from __future__ import annotations


class InsnavError(ValueError):
    """Data, settings or a log that cannot be used as they are; the classes below say which of them.

    Attributes
    ----------
    code : str
        A short name for programs, such as ``"unknown_config_key"``: the same as that of the command's JSON.
    message : str
        What is wrong, and where.
    remedy : str
        What to do about it; may be empty.
    time_s : float or None
        When, where the error belongs to an instant: seconds from the zero of the data, the scale of a solution's ``time_s``.
    time_ns : int or None
        The same on the clock of the data, exact: of ROS logs since 1970. Known also where the zero is not.
    measurement : str or None
        The measurement, sensor or quantity that the error is about, such as ``"imu"`` or ``"GNSS position"``.

    Examples
    --------
    >>> import insnav
    >>> try:
    ...     insnav.run("nowhere.mcap")
    ... except insnav.InsnavError as error:
    ...     print(type(error).__name__, error.code, error.remedy, sep=" | ")
    LogError | no_such_file | check the path
    """

    def __init__(
        self,
        message: str,
        code: str = "error",
        remedy: str = "",
        *,
        time_s: float | None = None,
        time_ns: int | None = None,
        measurement: str | None = None,
    ) -> None:
        # Those that stand in `args` and those of `__dict__` are what pickling and copying keep.
        super().__init__(message, code, remedy)
        self.message = message
        self.code = code
        self.remedy = remedy
        self.time_s = time_s
        self.time_ns = time_ns
        self.measurement = measurement

    def __str__(self) -> str:
        return f"{self.message}; {self.remedy}" if self.remedy else self.message


class ArgumentError(InsnavError):
    """An argument of the wrong shape, unit, range or name.

    Attributes
    ----------
    argument : str or None
        Which one; for columns of a mapping with the key before: ``"imu: time_s"``.
    received : str or None
        What it is, such as ``"shape (4, 3)"``.
    expected : str or None
        What it should be, such as ``"(5, 3)"``.
    """

    def __init__(
        self,
        message: str,
        code: str = "error",
        remedy: str = "",
        *,
        argument: str | None = None,
        received: str | None = None,
        expected: str | None = None,
        time_s: float | None = None,
        time_ns: int | None = None,
        measurement: str | None = None,
    ) -> None:
        super().__init__(message, code, remedy, time_s=time_s, time_ns=time_ns, measurement=measurement)
        self.argument = argument
        self.received = received
        self.expected = expected


class ConfigError(InsnavError):
    """Settings: an unknown key, or a value out of range.

    Attributes
    ----------
    key : str or None
        The whole key, such as ``"gnss.lever_arm_b_m"``.
    """

    def __init__(
        self,
        message: str,
        code: str = "error",
        remedy: str = "",
        *,
        key: str | None = None,
        time_s: float | None = None,
        time_ns: int | None = None,
        measurement: str | None = None,
    ) -> None:
        super().__init__(message, code, remedy, time_s=time_s, time_ns=time_ns, measurement=measurement)
        self.key = key


class LogError(InsnavError):
    """A file that cannot be read, understood or written.

    Attributes
    ----------
    path : str or None
        The file, as given.
    topic : str or None
        The topic, where it is about one.
    """

    def __init__(
        self,
        message: str,
        code: str = "error",
        remedy: str = "",
        *,
        path: str | None = None,
        topic: str | None = None,
        time_s: float | None = None,
        time_ns: int | None = None,
        measurement: str | None = None,
    ) -> None:
        super().__init__(message, code, remedy, time_s=time_s, time_ns=time_ns, measurement=measurement)
        self.path = path
        self.topic = topic


class AlignmentError(InsnavError):
    """No start is found in the data, or no attitude in the stops. ``time_s`` is the begin of the stop that it is about."""


class NavigationError(InsnavError):
    """Data that cannot be navigated: none of a kind, stamps that go backward, values that are not finite or make no sense."""


class IdentificationError(InsnavError):
    """A quantity that these data do not tell: noise, a clock's offset, a lag."""


class InsnavWarning(UserWarning):
    """Data or settings that look wrong, but can be used; the text ends with a remedy."""
