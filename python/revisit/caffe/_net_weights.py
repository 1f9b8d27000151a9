"""Weights of a net: the blobs of scripts, kept in sync with the engine."""

import warnings

import numpy as np

from . import _fillers
from ._blob import Blob
from ._structure import computing


def _same_bits(a, b):
    return a.shape == b.shape and np.array_equal(a.reshape(-1).view(np.uint32), b.reshape(-1).view(np.uint32))


class NetWeights:
    """Weights of all layers of a net.

    Nets of the engine are immutable. They are reloaded after a script wrote to weights. Blobs whose arrays a script accessed
    are compared bitwise with the engine's.

    layers: this class creates their blobs.
    full: Range of all layers, which receives the weights.
    file: a WeightsFile; None: layers are initialized by their fillers.
    """

    def __init__(self, layers, full, file=None):
        self._full = full
        self._in_engine = full.load(file or {})  # engine's layer name -> arrays
        self._weighted = []  # (engine's layer name, layer)
        shared = {}  # parameter name -> blob
        for name, layer in zip(full.names, computing(layers)):
            if name in self._in_engine:
                self._weighted.append((name, layer))
                self._make_blobs(layer, self._in_engine[name], shared)
        given = self._given_by(file)
        self._warn_of_missing(file, given)
        for _, layer in self._weighted:
            for i, blob in enumerate(layer.blobs):
                if id(blob) not in given:
                    blob.data[...] = _fillers.initial(layer.message, i, blob.shape)
                    given.add(id(blob))

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
        self._in_engine = self._full.load(file)
        given = self._given_by(file)
        self._warn_of_missing(file, given)
        for name, layer in self._weighted:
            for blob, values in zip(layer.blobs, self._in_engine[name]):
                if id(blob) in given:
                    blob.take(values)
                else:  # the engine has zeros
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
        """Reloads changed weights in the engine. Returns True if there were any."""
        if not self._changed():
            return False
        arrays = {name: [blob.read() for blob in layer.blobs] for name, layer in self._weighted}
        self._in_engine = self._full.load(arrays)
        for name, layer in self._weighted:
            for blob, values in zip(layer.blobs, self._in_engine[name]):
                if not blob.is_own:  # releases the old net
                    blob.take(values)
        return True
