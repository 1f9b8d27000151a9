"""What revisit raises on purpose. Each message says what was expected and found, and what to do."""

import builtins

__all__ = ['Error', 'InputError', 'Interrupted', 'MemoryError', 'UnsupportedError', 'UsageError']


class Error(Exception):
    """The base of them all; by itself what the system refused (no space, no permission)."""


class UsageError(Error, ValueError):
    """Something impossible was asked for: an unknown layer, a bad value."""


class InputError(Error):
    """A file is missing, malformed, or does not fit the others."""


class UnsupportedError(Error):
    """A well-formed network needs something that revisit does not have."""


class Interrupted(Error):
    """Work was stopped between two units of it; what was done is kept."""


class MemoryError(Error, builtins.MemoryError):
    """The system refused memory."""
