"""What engine.py promises, by the Python package `revisit`."""

import sys
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import revisit.engine
import revisit.proto

from .errors import ConversionError, InputError, UnsupportedError, UsageError
from .schema import raw_messages

_said = set()  # a conversion reads the same files several times


@contextmanager
def _our_errors():
    kinds = ((revisit.UsageError, UsageError), (revisit.InputError, InputError), (revisit.UnsupportedError, UnsupportedError),
             (revisit.Error, ConversionError))
    try:
        yield
    except revisit.Error as error:
        raise next(ours for theirs, ours in kinds if isinstance(error, theirs))(str(error)) from None


def _say(net):
    """Passes on the warnings of a net or file, once each."""
    try:
        warnings = net.warnings
    except UnicodeDecodeError:  # of names that are not text
        return
    for warning in warnings:
        if warning not in _said:
            _said.add(warning)
            print(f'warning: {warning}', file=sys.stderr)


def net_text(prototxt):
    with _our_errors():
        net = revisit.proto.read_net(prototxt)
    _say(net)
    return net.text()


def weights_bytes(file):
    with _our_errors(), Path(file).open('rb') as opened:
        if opened.read(4) != b'\x89HDF':
            return revisit.proto.read_net_binary(file).to_bytes()
        return _hdf5_bytes(file)


def _hdf5_bytes(file):
    weights = revisit.proto.WeightsFile(file)
    net = raw_messages.NetParameter()
    for index, (name, _) in enumerate(weights.layers):
        layer = net.layer.add(name=name)
        for array in weights.read(index):
            if array is None:
                raise InputError(f"{file}: layer '{name}' shares an array that the file has under another layer")
            blob = layer.blobs.add(data=np.ascontiguousarray(array, '<f4').tobytes())
            blob.shape.dim.extend(array.shape)
    return net.SerializeToString()


def outputs(prototxt, weights, inputs, end, graft, every_layer):
    with _our_errors():
        options = dict(end=end or '', graft=graft or '', inputs={blob: array.shape for blob, array in inputs.items()})
        if weights:
            net = revisit.engine.Net.load(prototxt, weights, **options)
        else:
            read = revisit.proto.read_net(prototxt)  # its bytes are weights without any
            net = revisit.engine.Net.load_from_memory(read.text(), read.to_bytes(), **options)
        _say(net)
        run = net.plan(keep_all=every_layer, accuracy=revisit.engine.Accuracy.STRICT).run()
        run.forward({blob: np.ascontiguousarray(array, np.float32) for blob, array in inputs.items()})
        if not every_layer:
            found = run.outputs()
        else:
            ports = [revisit.engine.port_name(layer.name, port) for layer in run.plan.layers for port in range(len(layer.outputs))]
            found = {port: run.layer_output(port) for port in ports}
        return {name.replace('/', '_'): np.array(array) for name, array in found.items()}
