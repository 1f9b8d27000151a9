"""Exceptions of revisit. Messages state what was expected and found, and how to fix it.

`code` is the exit code of commands that fail with the exception.
"""

import builtins

__all__ = ['Error', 'InputError', 'Interrupted', 'MemoryError', 'UnsupportedError', 'UsageError']


class Error(Exception):
    """Base class; raised itself for errors of the system (no space, no permission)."""

    code = 1


class UsageError(Error, ValueError):
    """Invalid argument: an unknown layer, a bad value."""

    code = 2


class InputError(Error):
    """A file is missing, malformed, or does not match the others."""

    code = 3


class UnsupportedError(Error):
    """A valid network needs a feature that revisit lacks."""

    code = 4


class Interrupted(Error):
    """Work was stopped early; finished parts are kept."""

    code = 130


class MemoryError(Error, builtins.MemoryError):
    """Out of memory."""
