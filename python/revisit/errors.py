"""What revisit raises on purpose. Each message says what was expected and found, and what to do.

`code` is the exit code of commands that end with the error.
"""

import builtins

__all__ = ['Error', 'InputError', 'Interrupted', 'MemoryError', 'UnsupportedError', 'UsageError']


class Error(Exception):
    """The base of them all; by itself what the system refused (no space, no permission)."""

    code = 1


class UsageError(Error, ValueError):
    """Something impossible was asked for: an unknown layer, a bad value."""

    code = 2


class InputError(Error):
    """A file is missing, malformed, or does not fit the others."""

    code = 3


class UnsupportedError(Error):
    """A well-formed network needs something that revisit does not have."""

    code = 4


class Interrupted(Error):
    """Work was stopped between two units of it; what was done is kept."""

    code = 130


class MemoryError(Error, builtins.MemoryError):
    """The system refused memory."""
