"""Runs the program `revisit`, which the package contains; a build with REVISIT_TOOLS=OFF lacks it.

Entry points of the commands `revisit` and `revisit-loops`.
"""

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

from revisit import errors

__all__ = ['loops', 'main', 'path', 'run']
ERRORS = {kind.code: kind for kind in (errors.UsageError, errors.InputError, errors.UnsupportedError, errors.Interrupted)}


def path() -> Path:
    """Returns the program in the package. Raises UnsupportedError if there is none."""
    bundled = Path(__file__).with_name('bin') / 'revisit'
    if not os.access(bundled, os.X_OK):
        raise errors.UnsupportedError('this package was built without the program `revisit` (REVISIT_TOOLS=OFF)')
    return bundled


def environment() -> dict[str, str]:
    """Returns the environment of the program, which reads recordings by this package."""
    return {'REVISIT_PYTHON': sys.executable} | os.environ


def run(*arguments: object, **options: Any) -> subprocess.CompletedProcess[str]:
    """Runs `revisit ARGUMENTS`, e.g. run('loops', folder). Captures the output as text; `options` are those of subprocess.run().

    Raises UsageError, InputError, UnsupportedError or Interrupted by the exit code, else Error, with the program's message.
    Does not raise for exit codes 5 (a check failed) and 6 (scans were skipped); see `returncode`.
    """
    options = {'text': True, 'stdout': subprocess.PIPE, 'stderr': subprocess.PIPE, 'env': environment()} | options
    done = subprocess.run([path(), *(os.fspath(word) if isinstance(word, os.PathLike) else str(word) for word in arguments)],
                          **options)
    if done.returncode in (0, 5, 6):
        return done
    raise ERRORS.get(done.returncode, errors.Error)((done.stderr or f'revisit: exit code {done.returncode}').strip())


def main(*command: str) -> int:
    """The command `revisit`. Replaces this process with the program."""
    try:
        program = path()
    except errors.UnsupportedError as error:
        print(f'revisit: {error}', file=sys.stderr)
        return error.code
    os.execve(program, ['revisit', *command, *sys.argv[1:]], environment())


def loops() -> int:
    """The command `revisit-loops`: `revisit loops`."""
    return main('loops')
