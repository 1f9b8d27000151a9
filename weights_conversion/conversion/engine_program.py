"""What engine.py promises, by the program `revisit`: the one that REVISIT_PROGRAM names, or the one on the path."""

import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

from .errors import BY_CODE, ConversionError


_said = set()  # a conversion reads the same files several times


def _program():
    program = os.environ.get('REVISIT_PROGRAM') or shutil.which('revisit')
    if not program:
        raise ConversionError("the program 'revisit' is not on the path; REVISIT_PROGRAM can name it")
    return program


def run(*words):
    """Runs `revisit WORDS`; its warnings are passed on, its errors are raised as ours."""
    try:
        done = subprocess.run([_program(), *map(str, words)], capture_output=True, text=True)
    except OSError as error:
        raise ConversionError(f'{_program()}: cannot run: {error.strerror}') from None
    lines = done.stderr.strip().splitlines()
    if done.returncode != 0:
        message = lines[-1].removeprefix('revisit: ') if lines else f'{_program()} ended with {done.returncode}'
        raise BY_CODE.get(done.returncode, ConversionError)(message)
    for line in lines:
        if line not in _said:
            _said.add(line)
            print(line, file=sys.stderr)


def net_text(prototxt):
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / 'net.prototxt'
        run('net', 'upgrade', '--inference', prototxt, out)
        return out.read_text()


def weights_bytes(file):
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / 'net.caffemodel'
        run('net', 'upgrade', file, out)
        return out.read_bytes()


def outputs(prototxt, weights, inputs, end, graft, every_layer):
    options = (['--end', end] if end else []) + (['--graft', graft] if graft else []) + (['--all'] if every_layer else [])
    return _outputs(prototxt, weights, inputs, options)


def _outputs(prototxt, weights, inputs, options):
    with tempfile.TemporaryDirectory() as folder:
        words = [prototxt, *([weights] if weights else []), '--accuracy', 'strict', '--output', folder, *options]
        for i, (blob, array) in enumerate(inputs.items()):
            file = Path(folder) / f'{i}.npy'
            np.save(file, np.ascontiguousarray(array, np.float32))
            words += ['--input', f'{blob}={file}']
        run('net', 'forward', *words)
        return {file.stem.removeprefix('out_'): np.load(file) for file in Path(folder).glob('out_*.npy')}
