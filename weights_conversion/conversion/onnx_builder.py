"""Writes the nodes of an ONNX graph."""

import numpy as np
from onnx import TensorProto, helper, numpy_helper

OPSET = 17  # ONNX Runtime 1.12 (2022) and later read it
IR_VERSION = 8
INT_MAX = np.iinfo(np.int64).max


class Builder:
    """Collects nodes and constants. Methods return the names of what they add."""

    def __init__(self, prefix=''):
        self.nodes, self.constants, self._prefix, self._known = [], {}, prefix, {}
        self._reshaped = {}  # {output: input} of reshapes to shapes known when the net runs

    def node(self, op, *inputs, n_outputs=None, **attributes):
        """Adds a node; returns the name of its output, or with n_outputs a list of names."""
        names = [f'{self._prefix}#{len(self.nodes)}.{i}' for i in range(n_outputs or 1)]
        self.nodes.append(helper.make_node(op, list(inputs), names, name=names[0], **attributes))
        return names if n_outputs else names[0]

    def constant(self, values, dtype=np.float32):
        """A constant; equal small ones are kept once."""
        array = np.asarray(values, dtype)
        key = (array.dtype.str, array.shape, array.tobytes()) if array.size <= 16 else None
        if key is None or key not in self._known:
            name = f'{self._prefix}${len(self.constants)}'
            self.constants[name] = array
            if key is None:
                return name
            self._known[key] = name
        return self._known[key]

    def integers(self, *values):
        """A constant vector of shapes, axes or indices."""
        return self.constant(values, np.int64)

    def shape(self, x, first=0, last=None):
        """The sizes of axes [first, last) of x, as a vector known when the net runs."""
        whole = self.node('Shape', x)
        if first == 0 and last is None:
            return whole
        return self.node('Slice', whole, self.integers(first), self.integers(INT_MAX if last is None else last))

    def reshape(self, x, *parts):
        """x in a shape put together from integers (0 copies the axis at that place, -1 is the rest) and vectors.

        ONNX Runtime (1.22) fuses a reshape to a computed shape with one to a constant shape after it, and does not load the
        result: the second reads what the first read.
        """
        if all(isinstance(part, int) and part != 0 for part in parts):
            x = self._reshaped.get(x, x)
        vectors, run = [], []
        for part in [*parts, None]:
            if isinstance(part, int):
                run.append(part)
                continue
            if run:
                vectors.append(self.integers(*run))
                run = []
            if part is not None:
                vectors.append(part)
        if not vectors:
            vectors = [self.constant([], np.int64)]
        shape = vectors[0] if len(vectors) == 1 else self.node('Concat', *vectors, axis=0)
        y = self.node('Reshape', x, shape)
        if shape not in self.constants:
            self._reshaped[y] = self._reshaped.get(x, x)
        return y

    def pad(self, x, before, after, value):
        """x with constant rows and columns around its last two axes: `before` and `after` are (rows, columns)."""
        return self.node('Pad', x, self.integers(0, 0, *before, 0, 0, *after), self.constant(value), mode='constant')

    def to_float(self, x):
        return self.node('Cast', x, to=TensorProto.FLOAT)

    def to_integers(self, x):
        return self.node('Cast', x, to=TensorProto.INT64)

    def affine(self, x, scale=1.0, shift=0.0):
        """x * scale + shift, without what changes nothing."""
        if scale != 1:
            x = self.node('Mul', x, self.constant(scale))
        if shift != 0:
            x = self.node('Add', x, self.constant(shift))
        return x

    def initializers(self, float16):
        """The constants as tensors, and the nodes that make float32 of those kept as float16."""
        tensors, casts = [], []
        for name, array in self.constants.items():
            if float16 and array.dtype == np.float32 and array.size > 16:
                with np.errstate(over='ignore'):
                    half = array.astype(np.float16)
                if np.array_equal(half.astype(np.float32), array):
                    casts.append(helper.make_node('Cast', [f'{name}h'], [name], to=TensorProto.FLOAT))
                    name, array = f'{name}h', half
            tensors.append(numpy_helper.from_array(array, name))
        return tensors, casts
