"""Weights of a net: initial values, synchronization with the engine, and files."""

import warnings

import numpy as np

from revisit._core.proto import net_of_layers

from .. import engine
from ._blob import Blob
from ._structure import computing
from .proto import caffe_pb2

_random = np.random.default_rng()  # seeds of passes
_fillers = np.random.default_rng()  # seeds of random weights
_n_seeds = 0


def set_random_seed(seed):
    """Seeds random weights of nets created later, and later passes of all nets. Values differ from the original Caffe's."""
    global _random, _fillers, _n_seeds
    _random, _fillers = (np.random.default_rng(each) for each in (seed, [seed, 1]))
    _n_seeds += 1


def n_seeds():
    """Returns the number of calls of set_random_seed(): a pass that was planned before another call has an old seed."""
    return _n_seeds


def pass_seed():
    """Returns a seed for Dropout layers that are active at inference (sample_weights_test)."""
    return int(_random.integers(2**63))


def _filler_seed():
    return int(_fillers.integers(2**63))


def fill(filler, shape):
    """Returns float32. Raises InputError for an unknown type."""
    return engine.filled(filler.SerializeToString(), list(shape), _filler_seed())


def _same_bits(a, b):
    return a.shape == b.shape and np.array_equal(a.reshape(-1).view(np.uint32), b.reshape(-1).view(np.uint32))


class NetWeights:
    """Weights of all layers of a net.

    Nets of the engine are immutable. They are reloaded after a script wrote to weights. Blobs whose arrays a script accessed
    are compared bitwise with the engine's.

    layers: this class creates their blobs.
    ranges: Ranges, whose net receives the weights.
    file: a WeightsFile; None: layers are initialized by their fillers.
    """

    def __init__(self, layers, ranges, file=None):
        self._ranges = ranges
        self._in_engine = ranges.load(file or {}, _filler_seed())  # engine's layer name -> arrays
        self._weighted = []  # (engine's layer name, layer)
        shared = {}  # parameter name -> blob
        for name, layer in zip(ranges.names, computing(layers)):
            if name in self._in_engine:
                self._weighted.append((name, layer))
                self._make_blobs(layer, self._in_engine[name], shared)
        self._warn_of_missing(file, self._given_by(file))

    @staticmethod
    def _make_blobs(layer, arrays, shared):
        params = layer.message.param
        for i, values in enumerate(arrays):
            parameter = params[i].name if i < len(params) else ''
            blob = shared.get(parameter) or Blob(values.shape, values)
            if parameter:
                shared[parameter] = blob
            layer.blobs.append(blob)

    def _given_by(self, file):
        """Returns the id() of the blobs that a WeightsFile has."""
        if file is None:
            return set()
        return {id(blob) for name, layer in self._weighted if name in file.layers for blob in layer.blobs}

    def _warn_of_missing(self, file, given):
        lacking = [layer.name for _, layer in self._weighted if any(id(blob) not in given for blob in layer.blobs)]
        if file and lacking:
            warnings.warn(
                f'{file.path}: no weights for the layers {", ".join(lacking)}; they keep their weights '
                '(in a new net: those of their fillers)',
                stacklevel=5,
            )

    def copy_from(self, file):
        """Warns about layers that the WeightsFile lacks."""
        self._in_engine = self._ranges.load(file)
        given = self._given_by(file)
        self._warn_of_missing(file, given)
        for name, layer in self._weighted:
            for blob, values in zip(layer.blobs, self._in_engine[name]):
                if id(blob) in given:
                    blob.take(values)
                else:  # the engine has other values
                    blob.may_be_written = True

    def share_with(self, other):
        """Uses the blobs of another net's layers of the same names. Raises ValueError if shapes differ."""
        theirs = {layer.name: layer for _, layer in reversed(other._weighted)}
        for _, layer in self._weighted:
            if layer.name not in theirs:
                continue
            blobs = theirs[layer.name].blobs
            shapes, wanted = ([blob.shape for blob in some] for some in (blobs, layer.blobs))
            if shapes != wanted:
                raise ValueError(
                    f"share_with: layer '{layer.name}': expected weights of shapes {wanted}, found {shapes} in the other net"
                )
            layer.blobs[:] = blobs
            for blob in blobs:
                blob.is_shared = blob.may_be_written = True

    def _changed(self):
        """True if a script changed weights since the last load()."""
        changed = False
        for name, layer in self._weighted:
            for blob, known in zip(layer.blobs, self._in_engine[name]):
                if not blob.may_be_written or blob.read() is known:
                    continue
                if not _same_bits(blob.read(), known):
                    changed = True
                elif not blob.is_shared and not blob.is_held:
                    blob.may_be_written = False
        return changed

    def update(self):
        """Reloads changed weights in the engine."""
        if not self._changed():
            return
        arrays = {name: [blob.read() for blob in layer.blobs] for name, layer in self._weighted}
        self._in_engine = self._ranges.load(arrays)
        for name, layer in self._weighted:
            for blob, values in zip(layer.blobs, self._in_engine[name]):
                if not blob.is_own:  # releases the old net
                    blob.take(values)


def net_file(name, layers):
    """Returns a NetFile with weights. layers: pairs of a LayerParameter without blobs and a list of arrays.

    Protobuf for Python would need minutes for the weights of a large net.
    """
    return net_of_layers(name, [(message.SerializeToString(), [np.asarray(array, np.float32, order='C') for array in arrays])
                                for message, arrays in layers])


def in_memory(arrays):
    """Returns the bytes of a caffemodel for the engine. arrays: layer name -> list of arrays."""
    layers = [(caffe_pb2.LayerParameter(name=name), blobs) for name, blobs in arrays.items()]
    # A caffemodel needs at least one layer.
    return net_file('net', layers or [(caffe_pb2.LayerParameter(name='none'), [])]).to_bytes()
