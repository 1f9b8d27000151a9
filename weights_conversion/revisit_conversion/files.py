"""Files that appear whole or not at all."""

import os
import tempfile
from contextlib import contextmanager
from pathlib import Path

from .errors import ConversionError, InputError, UsageError


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
        if path.exists() and not force:
            raise UsageError(f'{path} exists; --force overwrites it')
        if not path.parent.is_dir():
            raise UsageError(f'{path}: there is no folder {path.parent}')


@contextmanager
def appearing(*paths):
    """Temporary paths, one for each of `paths`, that take their places when the block ends well."""
    paths = [Path(path) for path in paths]
    try:
        with tempfile.TemporaryDirectory(dir=paths[0].parent, prefix='.revisit-convert-') as folder:
            parts = [Path(folder) / f'{i}{path.suffix}' for i, path in enumerate(paths)]
            yield parts
            for part, path in zip(parts, paths):
                os.replace(part, path)
    except OSError as error:
        raise ConversionError(f'{paths[0]}: cannot write: {error.strerror or error}') from None
