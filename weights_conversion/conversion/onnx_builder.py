"""Builder of ONNX graphs."""

import numpy as np
from onnx import TensorProto, helper, numpy_helper

OPSET = 17  # needs ONNX Runtime 1.12 (2022) or later
IR_VERSION = 8
INT_MAX = np.iinfo(np.int64).max


class Builder:
    """Collects nodes and constants. Methods return the names of the added tensors."""

    def __init__(self, prefix=''):
        self.nodes, self.constants, self._prefix, self._known = [], {}, prefix, {}
        self._reshaped = {}  # output -> input of reshapes to shapes computed at run time

    def node(self, op, *inputs, n_outputs=None, **attributes):
        """Adds a node. Returns the name of its output, or a list of names if n_outputs is given."""
        names = [f'{self._prefix}#{len(self.nodes)}.{i}' for i in range(n_outputs or 1)]
        self.nodes.append(helper.make_node(op, list(inputs), names, name=names[0], **attributes))
        return names if n_outputs else names[0]

    def constant(self, values, dtype=np.float32):
        """Adds a constant. Small equal constants are shared."""
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
        """Adds a constant int64 vector (shapes, axes or indices)."""
        return self.constant(values, np.int64)

    def shape(self, x, first=0, last=None):
        """Adds the sizes of axes [first, last) of x, computed at run time."""
        sizes = self.node('Shape', x)
        if first == 0 and last is None:
            return sizes
        return self.node('Slice', sizes, self.integers(first), self.integers(INT_MAX if last is None else last))

    def reshape(self, x, *parts):
        """Reshapes x to a concatenation of integers (0 copies the axis, -1 is inferred) and vectors.

        ONNX Runtime 1.22 fuses a reshape to a computed shape with a following one to a constant shape, and fails to load the
        result. The second reshape therefore reads the input of the first.
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
        """Pads the last two axes of x with a constant. before, after: (rows, columns)."""
        return self.node('Pad', x, self.integers(0, 0, *before, 0, 0, *after), self.constant(value), mode='constant')

    def to_float(self, x):
        return self.node('Cast', x, to=TensorProto.FLOAT)

    def to_integers(self, x):
        return self.node('Cast', x, to=TensorProto.INT64)

    def affine(self, x, scale=1.0, shift=0.0):
        """Adds x * scale + shift, without identity operations."""
        if scale != 1:
            x = self.node('Mul', x, self.constant(scale))
        if shift != 0:
            x = self.node('Add', x, self.constant(shift))
        return x

    def initializers(self, float16):
        """Returns the constants as tensors, and nodes that convert those stored as float16 to float32."""
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
