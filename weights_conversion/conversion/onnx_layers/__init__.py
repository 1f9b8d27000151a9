"""ONNX nodes of each layer type: a table from the type to a function that adds its nodes.

A function takes the builder and a Site, and returns the names of the layer's outputs. docs/reference/LAYERS.md defines Caffe's layers.
"""

from dataclasses import dataclass

from revisit.errors import UnsupportedError
from . import arithmetic, detections, moving, normalizing, pooling, recurrent, windows

EMIT = {**arithmetic.EMIT, **detections.EMIT, **moving.EMIT, **normalizing.EMIT, **pooling.EMIT, **recurrent.EMIT, **windows.EMIT}


@dataclass
class Site:
    """A layer and its inputs. Shapes are those of the example inputs."""

    layer: object  # graph.Layer
    x: list  # names of inputs
    shapes: list
    results: list  # outputs for the example
    blobs: list  # weights, with the shapes of the file
    fixed: bool  # sizes are fixed to those of the example

    @property
    def message(self):
        return self.layer.message

    def axis(self, axis, shape=None):
        """Converts a negative axis to a non-negative one."""
        return axis if axis >= 0 else axis + len(self.shapes[0] if shape is None else shape)

    def require_fixed(self, what):
        if not self.fixed:
            self.refuse(f'{what} the input size; export with --fixed')

    def refuse(self, why):
        raise UnsupportedError(f"layer '{self.layer.name}' ({self.layer.type}): {why}")
