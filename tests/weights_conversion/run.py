#!/usr/bin/env python3
"""Runs the tests of the converters (weights_conversion/conversion) in a separate virtual environment.

  tests/weights_conversion/run.py PACKAGE VENV [TEST...]

PACKAGE is the folder of the package `revisit` for this interpreter. VENV is created if missing, with
requirements.txt, and kept. Exit code 77: skipped, because the packages cannot be installed.
"""

import os
import shutil
import subprocess
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
REQUIREMENTS = HERE / 'requirements.txt'
SKIPPED = 77


def python_of(venv):
    """Returns the interpreter of a virtual environment with the packages, or None."""
    python, installed = venv / 'bin' / 'python', venv / 'requirements.txt'
    if installed.exists() and installed.read_text() == REQUIREMENTS.read_text():
        return python
    shutil.rmtree(venv, ignore_errors=True)
    for words in ([sys.executable, '-m', 'venv', str(venv)],
                  [str(python), '-m', 'pip', 'install', '--quiet', '--disable-pip-version-check', '-r', str(REQUIREMENTS)]):
        done = subprocess.run(words, capture_output=True, text=True)
        if done.returncode != 0:
            print(f'skipped: {" ".join(words[:4])} ... failed: {(done.stderr or done.stdout).strip()[-300:]}')
            return None
    shutil.copy(REQUIREMENTS, installed)
    return python


def main():
    if len(sys.argv) < 3:
        sys.exit(__doc__)
    package, venv = Path(sys.argv[1]).resolve(), Path(sys.argv[2]).resolve()
    python = python_of(venv)
    if python is None:
        return SKIPPED
    environment = os.environ | {'PYTHONDONTWRITEBYTECODE': '1', 'PYTHONPATH': f'{package}:{HERE.parents[1] / "weights_conversion"}'}
    tests = sys.argv[3:] or ['discover', '--pattern', '*_test.py']
    return subprocess.run([python, '-m', 'unittest', *tests], cwd=HERE, env=environment).returncode


if __name__ == '__main__':
    sys.exit(main())
