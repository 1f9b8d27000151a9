"""Atomic writing of files."""

import os
import tempfile
from contextlib import ExitStack, contextmanager
from pathlib import Path

from .errors import Error, InputError, UsageError


def existing(path):
    """Returns the path. Raises InputError unless it is a readable file."""
    path = Path(path)
    try:
        with path.open('rb') as file:
            file.read(1)
    except OSError as error:
        raise InputError(f'{path}: cannot open: {error.strerror}') from None
    return path


def may_write(force, *paths):
    """Raises UsageError if an output exists and must not be overwritten."""
    for path in map(Path, paths):
        if path.exists() and not path.is_file():
            raise UsageError(f'{path}: not a regular file, cannot be overwritten')
        if path.exists() and not force:
            raise UsageError(f'{path}: file exists; overwrite it with --force')
        if not path.parent.is_dir():
            raise UsageError(f'{path}: no folder {path.parent}')


@contextmanager
def appearing(*paths):
    """Yields one temporary path per path, and renames them when the block ends without an exception."""
    paths = [Path(path).resolve() for path in paths]
    try:
        with ExitStack() as stack:
            parts = [Path(stack.enter_context(tempfile.TemporaryDirectory(dir=path.parent, prefix='.revisit-convert-'))) / path.name
                     for path in paths]
            yield parts
            for part, path in zip(parts, paths):
                os.replace(part, path)
    except OSError as error:
        raise Error(f'{paths[0]}: cannot write: {error.strerror or error}') from None
