"""An array of a net, as scripts see it."""

import math
import sys

import numpy as np


class _Memory:
    """What blobs that share memory in Caffe show, each in its shape."""

    def __init__(self, values):
        self.own = None  # flat
        self.values = values  # of the engine, read-only, newer than `own`; None: `own` counts

    def at_least(self, count):
        """The first `count` numbers, in memory of its own."""
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
    """Sizes as integers. Scripts of Python 2's days divide them; a whole number stays one."""
    axes = tuple(int(axis) for axis in given)
    if axes != tuple(given) or any(axis < 0 for axis in axes):
        raise ValueError(f'a blob cannot have the shape {list(given)}: axes are whole numbers, 0 or more')
    return axes


class Blob:
    """Values in float32, C order, with a shape: an activation of a net, or weights.

    The values live in memory of the blob's own once a script has looked at them. Until then the blob points
    at what the engine computed or read, so that blobs nobody looks at cost nothing. `shares` is a blob that has the
    same memory.
    """

    def __init__(self, shape, values=None, shares=None):
        self._shape = tuple(int(axis) for axis in shape)
        self._memory = shares._memory if shares else _Memory(values)
        self._diff = None
        self.may_be_written = False  # a script had `data` since somebody compared the values
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
            raise ValueError(
                f'num, channels, height and width are of blobs with at most 4 axes; this has {self.shape}'
            )
        return self._shape[index] if index < len(self._shape) else 1

    num = property(lambda self: self._axis(0), doc='The first axis.')
    channels = property(lambda self: self._axis(1), doc='The second axis, 1 without it.')
    height = property(lambda self: self._axis(2), doc='The third axis, 1 without it.')
    width = property(lambda self: self._axis(3), doc='The fourth axis, 1 without it.')

    @property
    def data(self):
        """The values, float32 of `shape`. Writing into the array changes the blob.

        The array stays a view of the blob: it shows the values of later passes, as long as the shape stays.
        """
        self.may_be_written = True
        return self._own()

    @property
    def diff(self):
        """Zeros of `shape`: gradients are for training. Scripts may use the room."""
        if self._diff is None or self._diff.shape != self._shape:
            self._diff = np.zeros(self._shape, np.float32)
        return self._diff

    def reshape(self, *axes):
        """Changes the shape. Values stay in order where the new shape has room for no more than before.

        A net takes the new shape of an input at its next reshape() or forward().
        """
        if len(axes) == 1 and not np.isscalar(axes[0]):
            axes = tuple(axes[0])
        shape = _axes(axes)
        if shape == self._shape:
            return
        if self._memory.values is not None and math.prod(shape) <= self.count:
            self._own()
        self.become(shape)

    # What follows is for the net.

    def become(self, shape):
        """Takes another shape. What the engine had for the old one is dropped."""
        shape = tuple(shape)
        if shape != self._shape:
            self._memory.values = None
            self._shape = shape

    def read(self):
        """The values, not to be written to."""
        values = self._memory.values
        return self._own() if values is None or values.shape != self._shape else values

    def take(self, values):
        """Takes the shape and values of an array of the engine's, which stays theirs.

        They are copied now if a script holds an array of this blob, else when somebody asks for them.
        """
        self._shape, self._memory.values = values.shape, values
        if self.is_held:
            self._own()

    @property
    def is_own(self):
        """Whether the values are in memory of the blob's own, not the engine's."""
        return self._memory.values is None

    @property
    def is_held(self):
        """Whether a script has an array that shows, and may change, these values."""
        return self._memory.own is not None and _references(self) > _OWN_REFERENCES

    def _own(self):
        return self._memory.at_least(self.count).reshape(self._shape)


class BlobVec(list):
    """The blobs of a layer."""

    def add_blob(self, *axes):
        """Appends a blob of zeros."""
        self.append(Blob(axes))


# How many references there are to the memory of a blob that nobody holds an array of; Python versions differ.
_probe = Blob(())
_probe._own()
_OWN_REFERENCES = _references(_probe)
