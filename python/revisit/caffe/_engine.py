"""Nets of the engine, their number of threads, and passes over ranges of layers."""

import os
from collections import OrderedDict

from google.protobuf import text_format

from .. import engine, proto
from .._shared import named, set_threads, threads  # noqa: F401  caffe.set_threads
from ..errors import InputError
from . import _weights
from ._structure import computing
from .proto import caffe_pb2

_allow_unknown = False


def set_allow_unknown(allowed):
    """Allows unknown fields outside layer parameters in prototxts that are read later (default: False)."""
    global _allow_unknown
    _allow_unknown = bool(allowed)


def read_net(prototxt, phase, level, stages):
    """Returns the layers that run, as a NetParameter in the current format, and warnings.

    prototxt: file of any generation; for a solver's file, the net that it names is read.
    phase, level, stages: state for the include and exclude rules of layers, in addition to the file's stages.
    Raises InputError if the file cannot be read or does not parse.
    """
    try:
        file = proto.read_net(prototxt, allow_unknown_fields=_allow_unknown, keep_python=True,
                              train=phase == caffe_pb2.TRAIN, level=level, stages=stages)
    except InputError as error:
        raise InputError(str(error).replace('; allow unknown ', '; caffe.set_allow_unknown(True) ')) from None
    return caffe_pb2.NetParameter.FromString(file.to_bytes()), file.warnings


class WeightsFile:
    """Bytes of a .caffemodel or HDF5 file, and the names of its layers with weights."""

    def __init__(self, path):
        self.path = os.fspath(path)
        if isinstance(self.path, bytes):
            self.path = os.fsdecode(self.path)
        with open(self.path, 'rb') as file:
            self.content = file.read()
        layers = proto.WeightsFile.from_bytes(self.content, self.path).layers
        self.layers = {name for name, n_arrays in layers if n_arrays > 0}


_MAX_PASSES = 8  # cached passes of ranges with different input shapes; each has the memory of its blobs


class _Pass:
    def __init__(self, plan):
        self.plan = plan
        self.run = None  # allocated by the first forward()


class Ranges:
    """The layers that the engine computes, as one net. Outputs of layers in Python are inputs of this net.

    layers: from _structure.with_splits().
    shape_of: function from the name of a blob to its current shape.
    prototxt: file name for messages.
    """

    def __init__(self, layers, shape_of, prototxt):
        self._prototxt = prototxt
        self._layers = layers
        self._net = caffe_pb2.NetParameter(name='net')
        names, written = {}, set()
        for layer in computing(layers):
            inputs = [blob for blob in dict.fromkeys(layer.message.bottom) if blob not in written]
            for blob in inputs:
                added = self._net.layer.add(name=f'{blob} (input)', type='Input', top=[blob])
                added.input_param.shape.add(dim=shape_of(blob))
            added = self._net.layer.add()
            added.CopyFrom(layer.message)
            for field in ('include', 'exclude', 'blobs'):
                added.ClearField(field)
            while added.name in names:  # legal in Caffe, but the engine identifies layers by name
                added.name += ' (again)'
            names[added.name] = None
            written.update(inputs, added.top)
        self._draws = any(layer.dropout_param.sample_weights_test for layer in self._net.layer)
        self.names = list(names)  # the engine's names of the layers that it computes, in order
        self._engine = None
        self._parts = {}  # (first, last) -> part of the engine's net
        self._passes = OrderedDict()  # part, threads, seeds and input shapes -> _Pass, the oldest first

    def load(self, weights, seed=0):
        """Loads the engine's net. Returns layer name -> arrays of the engine.

        weights: a WeightsFile, or layer name -> list of arrays. Missing weights come from their fillers, seeded by `seed`.
        Raises InputError if layers and weights do not match, UnsupportedError if the engine lacks a layer type.
        """
        self._parts.clear()
        self._passes.clear()
        if not self.names:  # all layers run in Python
            return {}
        is_file = isinstance(weights, WeightsFile)
        content = weights.content if is_file else _weights.in_memory(weights)
        with named(self._prototxt, weights.path if is_file else "the net's weights"):
            self._engine = engine.Net.load_from_memory(
                text_format.MessageToString(self._net), content, allow_missing=True, fill_seed=seed)
        return self._engine.weights

    def part(self, first, last):
        """Returns the layers first to last, inclusive, as a net of the engine; None if none of them computes."""
        begin, end = (len(computing(self._layers[:index])) for index in (first, last + 1))
        if begin < end and (begin, end) not in self._parts:
            self._parts[begin, end] = self._engine.part(self.names[begin], self.names[end - 1])
        return self._parts.get((begin, end))

    def _pass(self, part, blobs):
        shapes = {name: blobs[name].shape for name in part.inputs}
        key = (id(part), threads(), _weights.n_seeds() if self._draws else 0, *map(tuple, shapes.values()))
        if key not in self._passes:
            while len(self._passes) >= _MAX_PASSES:
                self._passes.popitem(last=False)
            with named(self._prototxt):
                self._passes[key] = _Pass(part.plan(shapes, threads=threads(), seed=_weights.pass_seed()))
        self._passes.move_to_end(key)
        return self._passes[key]

    def shapes(self, part, blobs):
        """Returns name -> shape of the blobs that a part computes. blobs: name -> Blob."""
        return self._pass(part, blobs).plan.outputs

    def forward(self, part, blobs):
        """Runs a part. Returns name -> view of the blobs that it computes, in the order of writing."""
        current = self._pass(part, blobs)
        current.run = current.run or current.plan.run()
        current.run.forward({name: blobs[name].read() for name in part.inputs})
        return current.run.outputs()
