"""How each type of layer is said in ONNX: a table from the type to a function that adds its nodes.

A function takes the builder and a Site and returns the names of the layer's outputs. What Caffe computes is in
docs/LAYERS.md.
"""

from dataclasses import dataclass

from ..errors import UnsupportedError
from . import arithmetic, moving, normalising, pooling, recurrent, windows

EMIT = {**arithmetic.EMIT, **moving.EMIT, **normalising.EMIT, **pooling.EMIT, **recurrent.EMIT, **windows.EMIT}


@dataclass
class Site:
    """A layer and where it stands. Shapes are those of the example that the net is exported with."""

    layer: object  # graph.Layer
    x: list  # names of its inputs
    shapes: list  # of its inputs
    results: list  # its outputs for the example
    blobs: list  # its weights, as in the file
    fixed: bool  # the sizes of the example are the only ones

    @property
    def message(self):
        return self.layer.message

    def axis(self, axis, shape=None):
        """An axis counted from the front."""
        return axis if axis >= 0 else axis + len(self.shapes[0] if shape is None else shape)

    def refuse(self, why):
        raise UnsupportedError(f"layer '{self.layer.name}' ({self.layer.type}): {why}")
