#!/usr/bin/env python3
"""How far ONNX models of whole networks are from what the original Caffe computed, as a table.

  tests/weights_conversion/goldens.py FOLDER...

Each folder, or each folder in it, holds a prototxt, weights (if the net has some), in_BLOB.npy (or in.npy for the one input)
and out_OUTPUT.npy. Needs revisit-convert's packages and REVISIT_PROGRAM; run.py's VENV has the packages.
"""

import sys
import tempfile
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / 'weights_conversion'))

from revisit_conversion import compare, engine, onnx_export  # noqa: E402
from revisit_conversion.__main__ import parser  # noqa: E402
from revisit_conversion.errors import ConversionError  # noqa: E402


def only(folder, *patterns):
    """The one file that matches a pattern, or None."""
    return next((path for pattern in patterns for path in sorted(folder.glob(pattern))), None)


def measure(prototxt, weights, inputs, outputs, words=()):
    """Exports a net and runs the model.

    `inputs` {blob: file}, `outputs` {output: file}. Returns the largest differences of the model from Caffe and from the engine.
    """
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / 'net.onnx'
        given = [word for blob, path in inputs.items() for word in ('--input', f'{blob}={path}')]
        options = parser().parse_args(['onnx', str(prototxt), *([str(weights)] if weights else []), str(file),
                                       '--no-check', *given, *words])
        onnx_export.export(options, file)
        arrays = {blob: np.load(path) for blob, path in inputs.items()}
        caffe = {name: np.load(path) for name, path in outputs.items()}
        ours = engine.forward(prototxt, weights, arrays, [word for word in words if word != '--fixed'])
        model = onnx_export.Model(str(file))
        names = model.output_names()
        found = model.run(arrays, names)
        found = {engine.file_name(name).removesuffix('.out'): array for name, array in found.items()}
        return (max(compare.difference(found[name], array) for name, array in caffe.items()),
                max(compare.difference(found[name], array) for name, array in ours.items()))


def case(folder):
    """What `measure` takes for a folder."""
    prototxt = only(folder, 'net.prototxt', 'deploy.prototxt')
    inputs = {path.stem[3:]: path for path in folder.glob('in_*.npy')}
    if only(folder, 'in.npy'):
        inputs = {'data': folder / 'in.npy'}
    return prototxt, only(folder, 'weights.caffemodel*'), inputs, {p.stem[4:]: p for p in folder.glob('out_*.npy')}


def main(folders):
    print('| net | from Caffe | from the engine |\n|---|---|---|')
    for folder in map(Path, folders):
        for each in [folder] if only(folder, '*.prototxt') else sorted(folder.iterdir()):
            if not each.is_dir() or not only(each, '*.prototxt'):
                continue
            try:
                caffe, ours = measure(*case(each))
                print(f'| {each.name} | {caffe:.2g} | {ours:.2g} |', flush=True)
            except ConversionError as error:
                print(f'| {each.name} | {error} | |', flush=True)


if __name__ == '__main__':
    main(sys.argv[1:])
