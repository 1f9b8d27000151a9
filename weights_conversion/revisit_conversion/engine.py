"""What the program `revisit` does for the converters: it upgrades old files and runs networks.

The program is the one that REVISIT_PROGRAM names, or the one on the path.
"""

import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
from google.protobuf import text_format

from .errors import BY_CODE, ConversionError
from .schema import messages, raw_messages


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


def read_net(prototxt):
    """The part of a prototxt of any age that inference runs, in the current format (a NetParameter)."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / 'net.prototxt'
        run('net', 'upgrade', '--inference', prototxt, out)
        return text_format.Parse(out.read_text(), messages.NetParameter())


def read_weights(file):
    """The layers of a caffemodel of any age or of an HDF5 file, in the current format (a NetParameter of raw_messages)."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / 'net.caffemodel'
        run('net', 'upgrade', file, out)
        return raw_messages.NetParameter.FromString(out.read_bytes())


def forward(prototxt, weights, inputs, truncation=()):
    """Runs a network. `inputs` {blob: array}; `truncation` are the options --end and --graft with their values.

    Returns {output: array} of the network's outputs, each float32 in the shape that Caffe gives it.
    """
    return _outputs(prototxt, weights, inputs, truncation)


def layer_outputs(prototxt, weights, inputs, truncation=()):
    """The same for every layer: {'layer' or 'layer.port': array}."""
    return _outputs(prototxt, weights, inputs, ('--all', *truncation))


def _outputs(prototxt, weights, inputs, options):
    with tempfile.TemporaryDirectory() as folder:
        words = [prototxt, *([weights] if weights else []), '--accuracy', 'strict', '--output', folder, *options]
        for i, (blob, array) in enumerate(inputs.items()):
            file = Path(folder) / f'{i}.npy'
            np.save(file, np.ascontiguousarray(array, np.float32))
            words += ['--input', f'{blob}={file}']
        run('net', 'forward', *words)
        return {file.stem.removeprefix('out_'): np.load(file) for file in Path(folder).glob('out_*.npy')}


def file_name(output):
    """The name of an output in what `forward` and `layer_outputs` return."""
    return output.replace('/', '_')
