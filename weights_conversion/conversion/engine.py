"""Reading of Caffe files and inference by the package `revisit`."""

import sys
from pathlib import Path

import numpy as np
from google.protobuf import text_format

import revisit.engine
import revisit.proto
from revisit.caffe.proto import caffe_pb2

from revisit.errors import InputError

_printed = set()  # a conversion reads the same files several times


def _print_warnings(net):
    for warning in net.warnings:
        if warning not in _printed:
            _printed.add(warning)
            print(f'warning: {warning}', file=sys.stderr)


def read_net(prototxt, keep_unread=False):
    """Reads the inference layers of a prototxt of any version, as a NetParameter in the current format.

    keep_unread: skip fields of layers that do not parse, because the engine may not need these layers.
    """
    net = revisit.proto.read_net(prototxt, keep_unread=keep_unread)
    _print_warnings(net)
    try:
        return text_format.Parse(net.text(), caffe_pb2.NetParameter())
    except (text_format.ParseError, UnicodeError) as error:  # names that are not UTF-8
        raise InputError(f'{prototxt}: {" ".join(str(error).split())}') from None


def read_weights(file):
    """Reads a caffemodel of any version or an HDF5 file. Returns {layer: [float32 array, ...]} and {layer: type}, {} for HDF5."""
    weights, arrays = revisit.proto.WeightsFile(file), {}
    for index, (name, n_arrays) in enumerate(weights.layers):
        if n_arrays == 0:
            continue
        arrays[name] = weights.read(index)
        if any(array is None for array in arrays[name]):
            raise InputError(f"{file}: layer '{name}' shares an array with another layer, which is not supported")
    with Path(file).open('rb') as opened:
        is_hdf5 = opened.read(4) == b'\x89HDF'
    return arrays, {} if is_hdf5 else dict(revisit.proto.read_net_binary(file).layers)


def _run(prototxt, weights, inputs, end, graft, keep_all):
    options = dict(end=end, graft=graft, inputs={blob: array.shape for blob, array in inputs.items()})
    if weights:
        net = revisit.engine.Net.load(prototxt, weights, **options)
    else:
        net = revisit.engine.Net.load_without_weights(prototxt, **options)
    _print_warnings(net)
    run = net.plan(keep_all=keep_all, strict_accuracy=True).run()
    run.forward({blob: np.ascontiguousarray(array, np.float32) for blob, array in inputs.items()})
    return run


def forward(prototxt, weights, inputs, end='', graft=''):
    """Runs a network truncated after the layer `end`, with a copy of the layer `graft` appended.

    weights: a caffemodel or HDF5 file, or None. inputs: {blob: array}. Returns {output: float32 array}.
    """
    return {name: array.copy() for name, array in _run(prototxt, weights, inputs, end, graft, False).outputs().items()}


def layer_outputs(prototxt, weights, inputs, end='', graft=''):
    """Like forward(), for the outputs of every layer, with the names 'layer', 'layer.1', ..."""
    run = _run(prototxt, weights, inputs, end, graft, True)
    ports = [revisit.engine.port_name(layer.name, port) for layer in run.plan.layers for port in range(len(layer.outputs))]
    return {port: run.layer_output(port).copy() for port in ports}
