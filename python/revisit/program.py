"""The whole program `revisit`, which packages carry that were built with it: the command of the same name, and run().

Also the command `revisit-loops`: this module can be imported whatever the package was built with.
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
    """The program in the package, else on PATH. Raises UnsupportedError where it is in neither."""
    bundled = Path(__file__).with_name('bin') / 'revisit'
    if bundled.is_file() and os.access(bundled, os.X_OK):
        return bundled
    installed = shutil.which('revisit')
    if installed and Path(installed).resolve() != Path(sys.argv[0]).resolve():  # the command below may be on PATH, too
        return Path(installed)
    raise errors.UnsupportedError(
        'this package was built without the program `revisit`, and none is on PATH; build it with the program: '
        'pip install . -C cmake.define.REVISIT_TOOLS=ON, in the root of the sources')


def run(*arguments, **options) -> subprocess.CompletedProcess:
    """Runs `revisit ARGUMENTS`, e.g. run('loops', folder), and returns its output as text; options are subprocess.run()'s.

    Raises UsageError, InputError and UnsupportedError as the libraries do, else Error, with the message of the program.
    Codes 5 (a check failed) and 6 (scans were left out) are results: `returncode` has them.
    """
    options = {'text': True, 'stdout': subprocess.PIPE, 'stderr': subprocess.PIPE} | options
    done = subprocess.run([path(), *(os.fspath(word) if isinstance(word, os.PathLike) else str(word) for word in arguments)],
                          **options)
    if done.returncode in (0, 5, 6):
        return done
    raise ERRORS.get(done.returncode, errors.Error)((done.stderr or f'revisit: exit code {done.returncode}').strip())


def main():
    """The command `revisit`: this process becomes the program."""
    try:
        program = path()
    except errors.UnsupportedError as error:
        print(f'revisit: {error}', file=sys.stderr)
        return 4
    os.environ.setdefault('REVISIT_PYTHON', sys.executable)  # `revisit loops drive.bag` needs this package
    os.execv(program, ['revisit', *sys.argv[1:]])


def loops():
    """The command `revisit-loops`, which a package of the engine alone has, too, but cannot do."""
    from revisit import _core
    if not hasattr(_core, 'maps'):
        print('revisit-loops: this package is of the engine alone; build it with the pipeline: pip install . in the root of '
              'the sources, without REVISIT_PIPELINE=OFF', file=sys.stderr)
        return 4
    from revisit.loops.command import main as command
    return command()


if __name__ == '__main__':
    sys.exit(main())
