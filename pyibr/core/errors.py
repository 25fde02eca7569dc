"""Errors that pyibr raises. Every message names the expected and the received value."""

from __future__ import annotations


class Error(Exception):
    """Base of all errors that pyibr raises on purpose."""


class ArgumentError(Error, ValueError):
    """An argument has the wrong shape, dtype, range or value.

    Parameters
    ----------
    argument : str
        The argument's name as the caller wrote it.
    expected : str
        Description of a valid value.
    got : str
        Description of the received value.
    """

    def __init__(self, argument: str, expected: str, got: str) -> None:
        super().__init__(f"{argument}: expected {expected}, got {got}")
        self.argument, self.expected, self.got = argument, expected, got

    def __reduce__(self) -> tuple[type[ArgumentError], tuple[str, str, str]]:
        return ArgumentError, (self.argument, self.expected, self.got)


class FileFormatError(Error):
    """A file is missing, truncated or does not have the format of its name."""


class MissingPackageError(Error, ImportError):
    """An optional Python package is missing; the message contains the command that installs it."""


class DeviceError(Error, RuntimeError):
    """No OpenCL device works, or the chosen one failed."""


class OutOfMemoryError(DeviceError, MemoryError):
    """The device or the host has too little memory; the message says for what."""


class BuildError(DeviceError):
    """An OpenCL program failed to build; the message contains file, options and log."""
