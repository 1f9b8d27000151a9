"""Errors that end a conversion: those of the package `revisit`, and one more. `code` is the exit code."""

from revisit.errors import Error, InputError, UnsupportedError, UsageError

__all__ = ['CheckFailed', 'Error', 'InputError', 'UnsupportedError', 'UsageError']


class CheckFailed(Error):
    """The network that was written does not compute what the original computes."""

    code = 5
