"""Runs the program `revisit`, which a package contains if it was built with REVISIT_TOOLS=ON.

Entry points of the commands `revisit` and `revisit-loops`; this module imports in every build.
"""

import os
import shutil
import subprocess
import sys
from pathlib import Path

from revisit import errors

__all__ = ['loops', 'main', 'path', 'run']

ERRORS = {kind.code: kind for kind in (errors.UsageError, errors.InputError, errors.UnsupportedError, errors.Interrupted)}


def path() -> Path:
    """Returns the program in the package, else on PATH. Raises UnsupportedError if there is none."""
    bundled = Path(__file__).with_name('bin') / 'revisit'
    if bundled.is_file() and os.access(bundled, os.X_OK):
        return bundled
    installed = shutil.which('revisit')
    if installed and Path(installed).resolve() != Path(sys.argv[0]).resolve():  # not the entry point main() itself
        return Path(installed)
    raise errors.UnsupportedError(
        'the program `revisit` is neither in this package nor on PATH; build it with: '
        'pip install . -C cmake.define.REVISIT_TOOLS=ON, in the root of the sources')


def run(*arguments, **options) -> subprocess.CompletedProcess:
    """Runs `revisit ARGUMENTS`, e.g. run('loops', folder). Captures the output as text; `options` are those of subprocess.run().

    Raises UsageError, InputError, UnsupportedError or Interrupted by the exit code, else Error, with the program's message.
    Does not raise for exit codes 5 (a check failed) and 6 (scans were skipped); see `returncode`.
    """
    options = {'text': True, 'stdout': subprocess.PIPE, 'stderr': subprocess.PIPE} | options
    done = subprocess.run([path(), *(os.fspath(word) if isinstance(word, os.PathLike) else str(word) for word in arguments)],
                          **options)
    if done.returncode in (0, 5, 6):
        return done
    raise ERRORS.get(done.returncode, errors.Error)((done.stderr or f'revisit: exit code {done.returncode}').strip())


def main():
    """The command `revisit`. Replaces this process with the program."""
    try:
        program = path()
    except errors.UnsupportedError as error:
        print(f'revisit: {error}', file=sys.stderr)
        return 4
    os.environ.setdefault('REVISIT_PYTHON', sys.executable)  # `revisit loops drive.bag` needs this package
    os.execv(program, ['revisit', *sys.argv[1:]])


def loops():
    """The command `revisit-loops`. Fails with exit code 4 in a build without the pipeline."""
    from revisit import _core
    if not hasattr(_core, 'maps'):
        print('revisit-loops: this package has only the engine; build it with the pipeline: pip install . in the root of '
              'the sources, without REVISIT_PIPELINE=OFF', file=sys.stderr)
        return 4
    from revisit.loops.command import main as command
    return command()


if __name__ == '__main__':
    sys.exit(main())
