"""Errors that end a conversion. `code` is the exit code, with the meanings of the program `revisit`."""


class ConversionError(Exception):
    """The work failed; the message is one line for a person."""

    code = 1


class UsageError(ConversionError):
    """Something impossible was asked for."""

    code = 2


class InputError(ConversionError):
    """A file is missing, damaged or not what was expected."""

    code = 3


class UnsupportedError(ConversionError):
    """A sound network with something that the other format cannot say; names the layer and its type."""

    code = 4


class CheckFailed(ConversionError):
    """What was written does not compute what it was made from."""

    code = 5


BY_CODE = {kind.code: kind for kind in (ConversionError, UsageError, InputError, UnsupportedError, CheckFailed)}
