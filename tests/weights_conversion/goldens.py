#!/usr/bin/env python3
"""Differences of ONNX models of networks from outputs of the original Caffe, as a table.

  tests/weights_conversion/goldens.py FOLDER...

Each folder, or each folder in it, has a prototxt, weights (if the net has some), in_BLOB.npy (or in.npy for a single input)
and out_OUTPUT.npy; or it is golden/slim or golden/nets. The trunks of golden/nets are exported with another size than
that of their inputs. Needs the package `revisit` (PYTHONPATH) and those of run.py's VENV.
"""

import json
import sys
import tempfile
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / 'weights_conversion'))

from conversion import compare, engine, onnx_export  # noqa: E402
from conversion.__main__ import parser  # noqa: E402
from revisit.errors import Error  # noqa: E402


def only(folder, *patterns):
    """Returns the first file that matches a pattern, or None."""
    return next((path for pattern in patterns for path in sorted(folder.glob(pattern))), None)


def measure(prototxt, weights, inputs, outputs, end='', example=None):
    """Exports a net, runs the model, and returns its maximum differences from Caffe and from the engine.

    inputs: {blob: file}. outputs: {output: file}. end: value of --end.
    example: shape 'NxCxHxW' for the export, if other than that of the inputs.
    """
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / 'net.onnx'
        given = [word for blob, path in inputs.items() for word in ('--input', f'{blob}={path}')]
        if example:
            given = ['--input', example]
        options = parser().parse_args(['onnx', str(prototxt), *([str(weights)] if weights else []), str(file), '--no-check',
                                       *given, *(['--end', end] if end else [])])
        onnx_export.write(options, file)
        arrays = {blob: np.load(path) for blob, path in inputs.items()}
        caffe = {name: np.load(path) for name, path in outputs.items()}
        ours = {name.replace('/', '_'): array for name, array in engine.forward(prototxt, weights, arrays, *end.partition('+')[::2]).items()}
        model = onnx_export.Model(str(file))
        names = model.output_names()
        found = {name.removesuffix('.out').replace('/', '_'): array for name, array in model.run(arrays, names).items()}
        return (max(compare.difference(found[name], array) for name, array in caffe.items()),
                max(compare.difference(found[name], array) for name, array in ours.items()))


def case(folder):
    prototxt = only(folder, 'net.prototxt', 'deploy.prototxt')
    inputs = {path.stem[3:]: path for path in folder.glob('in_*.npy')}
    if only(folder, 'in.npy'):
        inputs = {'data': folder / 'in.npy'}
    return prototxt, only(folder, 'weights.caffemodel*'), inputs, {p.stem[4:]: p for p in folder.glob('out_*.npy')}


def cases(folder):
    """Yields (name, arguments of measure()) for all nets of a folder: cases, full nets (golden/slim) or trunks (golden/nets)."""
    for each in [folder] if only(folder, '*.prototxt') else sorted(path for path in folder.iterdir() if path.is_dir()):
        manifest = each / 'manifest.json'
        if not manifest.exists():
            if only(each, '*.prototxt'):
                yield each.name, case(each)
            continue
        inputs = each.parents[1] / 'inputs'
        facts = json.loads(manifest.read_text())
        if 'input' in facts:
            prototxt, weights, _, outputs = case(each)
            yield each.name, (prototxt, weights, {'data': inputs / Path(facts['input']).name}, outputs)
            continue
        for output in sorted(each.glob('out_*.npy')):
            variant, size = output.stem[4:].rsplit('_', 1)
            yield f'{each.name} {variant}, {size}', (
                each / 'pool5.prototxt', (each / facts['weights']).resolve(), {'data': inputs / f'in_1x3x{size}.npy'}, {variant: output},
                variant, '1x3x64x200')


def main(folders):
    print('| net | from Caffe | from the engine |\n|---|---|---|')
    for folder in map(Path, folders):
        for name, arguments in cases(folder):
            try:
                caffe, ours = measure(*arguments)
                print(f'| {name} | {caffe:.2g} | {ours:.2g} |', flush=True)
            except Error as error:
                print(f'| {name} | {error} | |', flush=True)


if __name__ == '__main__':
    main(sys.argv[1:])
