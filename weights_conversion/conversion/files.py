"""Files that appear whole or not at all."""

import os
import tempfile
from contextlib import ExitStack, contextmanager
from pathlib import Path

from .errors import Error, InputError, UsageError


def existing(path):
    """The path, which must be a readable file."""
    path = Path(path)
    try:
        with path.open('rb') as file:
            file.read(1)
    except OSError as error:
        raise InputError(f'{path}: cannot open: {error.strerror}') from None
    return path


def may_write(force, *paths):
    """Ends early when an output exists and may not be replaced."""
    for path in map(Path, paths):
        if path.exists() and not path.is_file():
            raise UsageError(f'{path} is not a file that can be replaced')
        if path.exists() and not force:
            raise UsageError(f'{path} exists; --force overwrites it')
        if not path.parent.is_dir():
            raise UsageError(f'{path}: there is no folder {path.parent}')


@contextmanager
def appearing(*paths):
    """Temporary paths, one for each of `paths`, that take their places when the block ends well."""
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
