"""The weights of a net: what scripts see and write, and what the engine has of it."""

import warnings

import numpy as np

from . import _fillers
from ._blob import Blob
from ._structure import computing


def _same_bits(a, b):
    return a.shape == b.shape and np.array_equal(a.reshape(-1).view(np.uint32), b.reshape(-1).view(np.uint32))


class NetWeights:
    """Weights of all layers of a net.

    The engine's nets cannot be changed: they are loaded again when a script wrote to weights. Only
    blobs whose arrays a script had are compared with what the engine has, bit for bit.

    Args:
        layers: of the net; they get their blobs.
        whole: the Range of all layers, which gets the weights.
        file: a WeightsFile, or None: then layers have what their fillers say.
    """

    def __init__(self, layers, whole, file=None):
        self._whole = whole
        self._in_engine = whole.load(file or {})  # arrays by the engine's name of the layer
        self._weighted = []  # (the engine's name, layer)
        shared = {}  # by the name of the parameter
        for name, layer in zip(whole.names, computing(layers)):
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
        """Which blobs a WeightsFile has, by id()."""
        if file is None:
            return set()
        return {id(blob) for name, layer in self._weighted if name in file.layers for blob in layer.blobs}

    def _warn_of_missing(self, file, given):
        lacking = [layer.name for _, layer in self._weighted if any(id(blob) not in given for blob in layer.blobs)]
        if file and lacking:
            warnings.warn(
                f'{file.path}: no weights for the layers {", ".join(lacking)}: they keep what they '
                'have, which is what their fillers say in a new net',
                stacklevel=5,
            )

    def copy_from(self, file):
        """Takes what a WeightsFile has; warns of layers that it lacks."""
        self._in_engine = self._whole.load(file)
        given = self._given_by(file)
        self._warn_of_missing(file, given)
        for name, layer in self._weighted:
            for blob, values in zip(layer.blobs, self._in_engine[name]):
                if id(blob) in given:
                    blob.take(values)
                else:  # the engine has zeros
                    blob.may_be_written = True

    def share_with(self, other):
        """Uses the blobs of another net's layers of the same names. Raises ValueError."""
        theirs = {layer.name: layer for _, layer in reversed(other._weighted)}
        for _, layer in self._weighted:
            if layer.name not in theirs:
                continue
            blobs = theirs[layer.name].blobs
            shapes, wanted = ([blob.shape for blob in some] for some in (blobs, layer.blobs))
            if shapes != wanted:
                raise ValueError(
                    f"layer '{layer.name}' has weights of {wanted}, the other net's has {shapes}: "
                    'they cannot be shared'
                )
            layer.blobs[:] = blobs
            for blob in blobs:
                blob.is_shared = blob.may_be_written = True

    def _changed(self):
        """Whether a script wrote to weights since the engine got them."""
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
        """Gives the engine the weights as they are now. Returns whether they changed."""
        if not self._changed():
            return False
        arrays = {name: [blob.read() for blob in layer.blobs] for name, layer in self._weighted}
        self._in_engine = self._whole.load(arrays)
        for name, layer in self._weighted:
            for blob, values in zip(layer.blobs, self._in_engine[name]):
                if not blob.is_own:  # lets go of the old net
                    blob.take(values)
        return True
