"""Compares ONNX Runtime on exported random nets with the reference kernels of the engine.

  env PYTHONPATH=build/dev/python build/dev/conversion_venv/bin/python tests/random_nets/onnx_oracle.py build/dev/tests/revisit_random_nets
      [--minutes M] [--first-seed N] [--nets K]

`tests/weights_conversion/run.py` makes the virtual environment. A fault is printed with its seed, and the exit code is 1.

Compares every layer channel by channel, at the exported sizes and at the other sizes of its seed, then the outputs alone,
where ONNX Runtime fuses layers. The tolerance for rounding is measured (check.h): the reference ran again with noise after
each layer that rounds. A layer that the export rejects becomes an input of the model, with the engine's values, and is
counted, so that the other layers are still compared. Models that require fixed sizes are exported once more. Layers that
suppress boxes become inputs, too, because rounding decides which rows they have (onnx_detections_test.py compares them).
"""

import argparse
import collections
import dataclasses
import re
import resource
import subprocess
import sys
import tempfile
import time
import traceback
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / 'weights_conversion'))
from conversion import onnx_export, weights  # noqa: E402
from conversion.compare import CheckFailed  # noqa: E402
from conversion.graph import resolve  # noqa: E402
from conversion.onnx_layers import detections  # noqa: E402
from revisit.caffe.proto import caffe_pb2  # noqa: E402
from revisit.errors import UnsupportedError  # noqa: E402

BATCH = 20
HUNDREDTH = 0.01
DEPTHWISE = ('ConvolutionDepthwise', 'DepthwiseConvolution')
FEW = 16  # values of a channel whose magnitude is random


@dataclasses.dataclass
class Statistics:
    nets: int = 0
    too_large: int = 0  # nets with NaN or values near infinity, which are not compared
    other_sizes: int = 0  # nets run at sizes that they were not exported with
    fixed: int = 0  # nets exported with fixed sizes, too
    outputs: int = 0  # compared, of all layers and runs
    insensitive: int = 0  # of these: with a tolerance above a hundredth of the values
    refused: collections.Counter = dataclasses.field(default_factory=collections.Counter)  # layers, by type and reason
    faults: int = 0

    def __str__(self):
        cpu = sum(sum(resource.getrusage(who)[:2]) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
        return (f'{self.nets} nets ({self.too_large} with NaN or values near infinity, {self.other_sizes} with two shapes, '
                f'{self.fixed} with fixed sizes), {self.outputs} outputs compared, {self.insensitive} of them insensitive, '
                f'{sum(self.refused.values())} layers refused, {self.faults} faults, {cpu:.0f} s of CPU')


class Case:
    def __init__(self, folder):
        self._folder = folder
        net = caffe_pb2.NetParameter.FromString((folder / 'net.caffemodel').read_bytes())
        self.blobs = weights.read(folder / 'net.caffemodel')
        end, graft = (folder / 'truncation.txt').read_text().splitlines()
        self.graph = resolve(net, end, graft)
        self.inputs, self.values, self.explained = [], [], []  # per set of sizes
        for sizes in sorted(path for path in folder.iterdir() if path.is_dir()):
            self.inputs.append({path.stem.removeprefix('in_'): np.load(path) for path in sizes.glob('in_*.npy')})
            self.values.append(self._of_values(sizes, ''))
            self.explained.append(self._of_values(sizes, '.off'))

    def is_too_large(self):
        return not all(self.values)

    def _of_values(self, sizes, ending):
        files = {value: sizes / f'{port}{ending}.npy' for layer in self.graph.layers for port, value in zip(layer.ports(), layer.outputs)}
        return {value: np.load(file) for value, file in files.items() if file.exists()}

    def make_input(self, layer):
        """Replaces the layer's outputs by inputs of the net with the engine's values."""
        layer.type, layer.inputs = 'Input', []
        for port, value in zip(layer.ports(), layer.outputs):
            self.graph.blobs[value] = f'{port} (given)'
            for inputs, values in zip(self.inputs, self.values):
                inputs[self.graph.blobs[value]] = values[value]
        needed = {value for layer in self.graph.layers for value in layer.inputs} | {value for _, value in self.graph.outputs}
        self.graph.layers = [layer for layer in self.graph.layers if layer.type != 'Input' or needed.intersection(layer.outputs)]

    def build(self, example, fixed, refused):
        """Returns the model and the names of its tensors. Rejected layers become inputs and are added to `refused`."""
        for layer in self.graph.layers:
            if layer.type in detections.EMIT:
                self.make_input(layer)
        while True:
            try:
                onnx_export.refuse_unknown(self.graph)
                return onnx_export.build(self.graph, self.blobs, self.values[example], self.inputs[example], fixed)
            except UnsupportedError as error:
                name, kind, why = re.fullmatch(r"layer '(.*?)' \((.*?)\): (.*)", str(error)).groups()
                refused.append((kind, re.sub(r'\d+', 'N', why)))
                self.make_input(next(layer for layer in self.graph.layers if layer.name == name))


def channels(array):
    """Returns [channel][number]; arrays of less than two axes are one channel."""
    return np.moveaxis(array, 1, 0).reshape(array.shape[1], -1) if array.ndim > 1 else array.reshape(1, -1)


def largest(array):
    return np.abs(channels(array.astype(np.float64))).max(axis=1, initial=0)


def is_insensitive(expected, explained):
    sizes = largest(expected)
    if expected.size < FEW * sizes.size:
        sizes[:] = sizes.max(initial=0)
    return bool((explained > HUNDREDTH * sizes).any())


def difference(found, expected, explained):
    """Returns None, or the difference and its ratio to the tolerance for rounding."""
    if found.shape != expected.shape:
        return f'is {found.shape}, expected {expected.shape}', np.inf
    off = np.nan_to_num(largest(found.astype(np.float64) - expected), nan=np.inf)
    times = np.divide(off, explained, out=np.where(off > 0, np.inf, 0.0), where=explained > 0)
    c = int(times.argmax())
    if times[c] <= 1:
        return None
    at = np.unravel_index(int(np.nan_to_num(np.abs(channels(found)[c].astype(np.float64) - channels(expected)[c]), nan=np.inf).argmax()),
                          channels(found)[c].shape)
    return (f'{expected.shape}, channel {c}: off by {off[c]:.3g}, rounding explains {explained[c]:.3g}; '
            f'{channels(found)[c][at]:.9g}, expected {channels(expected)[c][at]:.9g}'), times[c]


def compare(case, which, names, found, sizes, statistics):
    wrong = []
    for layer in case.graph.layers:
        for port, value in zip(layer.ports(), layer.outputs):
            if names.get(value) not in found or layer.type == 'Input':
                continue
            expected, explained = case.values[sizes][value], case.explained[sizes][value].astype(np.float64)
            statistics.outputs += 1
            statistics.insensitive += is_insensitive(expected, explained)
            off = difference(found[names[value]], expected, explained)
            if off:
                wrong.append((off[1], f"'{port}' ({layer.type}) {off[0]}"))
    if not wrong:
        return ''
    worst = max(wrong)
    return f'{which}: {wrong[0][1]}' + (f'\n  worst of {len(wrong)}: {worst[1]}' if worst is not wrong[0] else '')


def run_at(case, model, names, sizes, statistics):
    everything, expected = onnx_export.with_every_layer(model, names, case.values[0])
    outputs = [output.name for output in model.graph.output]
    values = dict(names)  # outputs may have another name than their value
    for (_, value), name in zip(case.graph.outputs, outputs):
        values[value] = name
    for which, each, wanted, tensors in (('every layer', everything, list(expected), names), ('outputs', model, outputs, values)):
        if wanted:
            found = onnx_export.Model(each.SerializeToString(), threads=1).run(case.inputs[sizes], wanted)
            fault = compare(case, which, tensors, found, sizes, statistics)
            if fault:
                return fault
    return ''


def takes(case, model, sizes):
    """Whether these sizes of the net are free in the model. Channels of an input of four axes, or of a depthwise convolution, are
    not, because groups are an attribute."""
    groups = [[values[layer.inputs[0]].shape[1] for layer in case.graph.layers if layer.type in DEPTHWISE]
              for values in (case.values[0], case.values[sizes])]
    return groups[0] == groups[1] and all(
        dim.dim_value in (0, size) for i in model.graph.input
        for dim, size in zip(i.type.tensor_type.shape.dim, case.inputs[sizes][i.name].shape))


def find_fault(folder, statistics):
    statistics.nets += 1
    known = []
    for fixed in (False, True):
        case, refused = Case(folder), []
        if case.is_too_large():
            statistics.too_large += 1
            return ''
        model, names = case.build(0, fixed, refused)
        if not fixed:
            for example in range(1, len(case.values)):  # because a kernel may not fit
                before = len(refused)
                case.build(example, fixed, refused)
                if len(refused) > before:
                    model, names = case.build(0, fixed, refused)
        statistics.refused.update(collections.Counter(refused) - collections.Counter(known))
        known = refused
        statistics.fixed += fixed
        runs = [sizes for sizes in range(len(case.values)) if sizes == 0 or not fixed and takes(case, model, sizes)]
        statistics.other_sizes += len(runs) > 1
        for sizes in runs:
            try:
                onnx_export.require_valid(model)
                fault = run_at(case, model, names, sizes, statistics)
            except CheckFailed as error:
                fault = str(error)
            if fault:
                return f'{"fixed sizes" if fixed else f"sizes {sizes}"}, {fault}'
        if not any('--fixed' in why for _, why in refused):
            return ''
    return ''


def check(program, first_seed, nets, minutes, statistics):
    """Stops after a time limit; returns the next seed."""
    begin = said = time.monotonic()
    seed, end = first_seed, first_seed + nets
    while seed < end and time.monotonic() < begin + 60 * minutes:
        with tempfile.TemporaryDirectory() as folder:
            n = min(BATCH, end - seed)
            subprocess.run([program, '--first-seed', str(seed), '--nets', str(n), '--minutes', '1e9', '--save', folder], check=True)
            for seed in range(seed, seed + n):
                try:
                    fault = find_fault(Path(folder) / str(seed), statistics)
                except Exception:  # of the export, most likely
                    fault = traceback.format_exc()
                if fault:
                    statistics.faults += 1
                    print(f'FAULT seed {seed}: {fault}', flush=True)
            seed += 1
        if time.monotonic() > said + 60:
            said = time.monotonic()
            print(f'{statistics}, {statistics.nets / (said - begin):.1f} nets/s, next seed {seed}', flush=True)
    return seed


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('program', help='revisit_random_nets')
    parser.add_argument('--minutes', type=float, default=1)
    parser.add_argument('--first-seed', type=int, default=1_000_000)
    parser.add_argument('--nets', type=int, default=2**63)
    options = parser.parse_args()
    statistics = Statistics()
    seed = check(options.program, options.first_seed, options.nets, options.minutes, statistics)
    print(f'{statistics}, next seed {seed}')
    for (kind, why), n in sorted(statistics.refused.items()):
        print(f'refused {n}: {kind}: {why}')
    return 1 if statistics.faults else 0


if __name__ == '__main__':
    sys.exit(main())
