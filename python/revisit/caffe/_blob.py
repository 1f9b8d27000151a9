"""Blob: an array of a net in pycaffe's interface."""

import math
import sys

import numpy as np


class _Memory:
    """Memory of the blobs that share it in Caffe, each with its own shape."""

    def __init__(self, values):
        self.own = None  # flat
        self.values = values  # read-only array of the engine, newer than `own`; None: `own` is current

    def at_least(self, count):
        """Returns the first `count` values in owned memory."""
        needed = max(count, 0 if self.values is None else self.values.size)
        if self.own is None or self.own.size < needed:
            self.own = np.zeros(needed, np.float32)
        if self.values is not None:
            self.own[: self.values.size] = self.values.reshape(-1)
            self.values = None
        return self.own[:count]


def _references(blob):
    return sys.getrefcount(blob._memory.own)


def _axes(given):
    """Returns sizes as integers. Accepts integral floats, because scripts for Python 2 divide sizes."""
    axes = tuple(int(axis) for axis in given)
    if axes != tuple(given) or any(axis < 0 for axis in axes):
        raise ValueError(f'Blob: expected a shape of integers >= 0, found {list(given)}')
    return axes


class Blob:
    """Activations or weights of a net: float32 in C order.

    The blob refers to the engine's array until a script accesses the values, which copies them to owned memory. Blobs that
    no script accesses therefore cost nothing. `shares` is a blob with the same memory.
    """

    def __init__(self, shape, values=None, shares=None):
        self._shape = tuple(int(axis) for axis in shape)
        self._memory = shares._memory if shares else _Memory(values)
        self._diff = None
        self.may_be_written = False  # a script accessed `data` since the last comparison of values
        self.is_shared = False  # with another net

    @property
    def shape(self):
        """The axes as a list, slowest first."""
        return list(self._shape)

    @property
    def count(self):
        """The number of values."""
        return math.prod(self._shape)

    def _axis(self, index):
        if len(self._shape) > 4:
            raise ValueError(f'Blob: num, channels, height and width need at most 4 axes, found shape {self.shape}')
        return self._shape[index] if index < len(self._shape) else 1

    num = property(lambda self: self._axis(0), doc='The first axis.')
    channels = property(lambda self: self._axis(1), doc='The second axis, 1 without it.')
    height = property(lambda self: self._axis(2), doc='The third axis, 1 without it.')
    width = property(lambda self: self._axis(3), doc='The fourth axis, 1 without it.')

    @property
    def data(self):
        """Writable view of the values, float32 of `shape`. It shows later passes while the shape is unchanged."""
        self.may_be_written = True
        return self._own()

    @property
    def diff(self):
        """Zeros of `shape`, because gradients are for training. Scripts may write to the array."""
        if self._diff is None or self._diff.shape != self._shape:
            self._diff = np.zeros(self._shape, np.float32)
        return self._diff

    def reshape(self, *axes):
        """Changes the shape. Values keep their order if the new shape has no more values than the old one.

        A net applies the new shape of an input at its next reshape() or forward().
        """
        if len(axes) == 1 and not np.isscalar(axes[0]):
            axes = tuple(axes[0])
        shape = _axes(axes)
        if shape == self._shape:
            return
        if self._memory.values is not None and math.prod(shape) <= self.count:
            self._own()
        self.become(shape)

    # Internal interface for Net.

    def become(self, shape):
        """Sets the shape. Drops the engine's array for another shape."""
        shape = tuple(shape)
        if shape != self._shape:
            self._memory.values = None
            self._shape = shape

    def read(self):
        """Returns the values, which must not be written."""
        values = self._memory.values
        return self._own() if values is None or values.shape != self._shape else values

    def take(self, values):
        """Sets shape and values from an array that the engine owns.

        Copies the values now if a script holds an array of this blob, else at the first access.
        """
        self._shape, self._memory.values = values.shape, values
        if self.is_held:
            self._own()

    @property
    def is_own(self):
        """True if the blob owns the memory of the values, instead of the engine."""
        return self._memory.values is None

    @property
    def is_held(self):
        """True if a script holds an array that may change these values."""
        return self._memory.own is not None and _references(self) > _OWN_REFERENCES

    def _own(self):
        return self._memory.at_least(self.count).reshape(self._shape)


class BlobVec(list):
    """The blobs of a layer."""

    def add_blob(self, *axes):
        """Appends a blob of zeros."""
        self.append(Blob(axes))


# Reference count of the memory of a blob that no script holds; it differs between Python versions.
_probe = Blob(())
_probe._own()
_OWN_REFERENCES = _references(_probe)
