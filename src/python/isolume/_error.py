"""The one exception of the package."""

from __future__ import annotations


class Error(Exception):
    """What cannot be done, and why.

    The message is a sentence that names what was given, what was expected, and what to do. Its parts are attributes, ``None``
    where they do not apply.

    >>> try:
    ...     isolume.open("no-such-file.nrrd")
    ... except isolume.Error as error:
    ...     print(error.name, "|", error.expected)
    volume | a volume file that exists, or the name of a field
    """

    kind: str
    """``argument``, ``format``, ``io``, ``limit``, ``mismatch``, ``unbaked``, ``locked``, ``stopped`` or ``other``."""
    path: str | None
    """The file or store that it is about."""
    name: str | None
    """The argument, or what was asked for."""
    given: str | None
    """What was given, or found in a file."""
    expected: str | None
    """What is possible there."""
    remedy: str | None
    """What to do about it."""

    def __init__(
        self,
        message: str,
        *,
        kind: str | None = None,
        path: str | None = None,
        name: str | None = None,
        given: str | None = None,
        expected: str | None = None,
        remedy: str | None = None,
    ) -> None:
        super().__init__(message)
        self.kind = kind or "other"
        self.path, self.name, self.given, self.expected, self.remedy = path, name, given, expected, remedy

    def __reduce__(self):
        return _again, (str(self), self.__dict__)


def _again(message: str, parts: dict) -> Error:
    return Error(message, **parts)


def argument(name: str, given: object, expected: str, remedy: str) -> Error:
    """An argument that cannot be, in the words of the library."""
    text = f"{name}: given {given}, expected {expected}; {remedy}"
    return Error(text, kind="argument", name=name, given=str(given), expected=expected, remedy=remedy)
