"""Reading old files and running networks, by the libraries of the package `revisit`."""

import sys
from pathlib import Path

import numpy as np
from google.protobuf import text_format

import revisit.engine
import revisit.proto
from revisit.caffe.proto import caffe_pb2

from .errors import InputError

_said = set()  # a conversion reads the same files several times


def _say(net):
    """Passes on the warnings of a net or file, once each."""
    for warning in net.warnings:
        if warning not in _said:
            _said.add(warning)
            print(f'warning: {warning}', file=sys.stderr)


def read_net(prototxt, keep_unread=False):
    """The part of a prototxt of any age that inference runs, in the current format (a NetParameter).

    keep_unread: what does not parse in a layer is left out, for whoever asks the engine about layers that are needed.
    """
    net = revisit.proto.read_net(prototxt, keep_unread=keep_unread)
    _say(net)
    try:
        return text_format.Parse(net.text(), caffe_pb2.NetParameter())
    except (text_format.ParseError, UnicodeError) as error:  # names that are not text
        raise InputError(f'{prototxt}: {" ".join(str(error).split())}') from None


def read_weights(file):
    """The arrays {layer: [float32 array, ...]} of a caffemodel of any age or of an HDF5 file, and {layer: type} where it says them."""
    weights, arrays = revisit.proto.WeightsFile(file), {}
    for index, (name, n_arrays) in enumerate(weights.layers):
        if n_arrays == 0:
            continue
        arrays[name] = weights.read(index)
        if any(array is None for array in arrays[name]):
            raise InputError(f"{file}: layer '{name}' shares an array that the file has under another layer")
    with Path(file).open('rb') as opened:
        is_hdf5 = opened.read(4) == b'\x89HDF'
    return arrays, {} if is_hdf5 else dict(revisit.proto.read_net_binary(file).layers)


def _run(prototxt, weights, inputs, end, graft, keep_all):
    """A finished pass of the network."""
    options = dict(end=end or '', graft=graft or '', inputs={blob: array.shape for blob, array in inputs.items()})
    if weights:
        net = revisit.engine.Net.load(prototxt, weights, **options)
    else:
        net = revisit.engine.Net.load_without_weights(prototxt, **options)
    _say(net)
    run = net.plan(keep_all=keep_all, accuracy=revisit.engine.Accuracy.STRICT).run()
    run.forward({blob: np.ascontiguousarray(array, np.float32) for blob, array in inputs.items()})
    return run


def forward(prototxt, weights, inputs, end=None, graft=None):
    """Runs a network, cut off after the layer `end`, with a copy of the layer `graft` behind it.

    `weights` is a caffemodel or HDF5 file, or None; `inputs` {blob: array}. Returns {output: float32 array}.
    """
    return {name: array.copy() for name, array in _run(prototxt, weights, inputs, end, graft, False).outputs().items()}


def layer_outputs(prototxt, weights, inputs, end=None, graft=None):
    """The same for the outputs of every layer, by the names 'layer' and 'layer.1'."""
    run = _run(prototxt, weights, inputs, end, graft, True)
    ports = [revisit.engine.port_name(layer.name, port) for layer in run.plan.layers for port in range(len(layer.outputs))]
    return {port: run.layer_output(port).copy() for port in ports}
