"""Exceptions of the conversion: those of the package `revisit`, and CheckFailed. `code` is the exit code."""

from revisit.errors import Error, InputError, UnsupportedError, UsageError

__all__ = ['CheckFailed', 'Error', 'InputError', 'UnsupportedError', 'UsageError']


class CheckFailed(Error):
    """Outputs of the converted network differ from the original's."""

    code = 5
