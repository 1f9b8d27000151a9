"""Networks as graphs of layers and values in single-assignment form: in-place layers write new values."""

from dataclasses import dataclass

import numpy as np

from revisit import engine, proto

from revisit.errors import UnsupportedError


@dataclass
class Layer:
    """A layer; `inputs` and `outputs` are indices of values."""

    name: str
    type: str
    message: object  # LayerParameter; None for a Split that proto.resolve() inserted
    inputs: list
    outputs: list

    def ports(self):
        """Returns the engine's names of its outputs: 'layer', 'layer.1', ..."""
        return [engine.port_name(self.name, i) for i in range(len(self.outputs))]


@dataclass
class Graph:
    """layers: in the order of the file. blobs: name of each value. outputs: pairs (name, value)."""

    layers: list
    blobs: list
    outputs: list

    def require_unique_names(self):
        """Rejects duplicate names (legal in Caffe), because names identify weights and outputs."""
        names = set()
        for layer in self.layers:
            if layer.name in names:
                raise UnsupportedError(f"duplicate layer name '{layer.name}'; give each layer its own name")
            names.add(layer.name)

    def readers(self, value):
        return [layer for layer in self.layers if value in layer.inputs]


def is_of_batch(message):
    """Whether a BatchNorm layer uses the statistics of the current batch."""
    p = message.batch_norm_param
    in_training = message.HasField('phase') and message.phase == 0  # TRAIN
    return not p.use_global_stats if p.HasField('use_global_stats') and not has_scale(p) else in_training


def has_scale(p):
    """Whether a BatchNormParameter is of NVIDIA's fork, with a trained scale and bias."""
    return p.scale_bias or p.HasField('scale_filler') or p.HasField('bias_filler')


def statistics(p, blobs):
    """Returns mean, variance, scale, bias and eps of a BatchNorm with stored statistics. blobs: its flat arrays."""
    if has_scale(p):
        return blobs[0], blobs[1], blobs[3], blobs[4], max(p.eps, 1e-5)  # cuDNN's least eps
    factor = blobs[2].dtype.type(0 if blobs[2][0] == 0 else 1 / blobs[2][0])  # 0: no statistics
    ones = np.ones_like(blobs[0])
    return factor * blobs[0], factor * blobs[1], ones, np.zeros_like(ones), p.eps


def resolve(net, end='', graft=''):
    """Returns the graph of a NetParameter in the current format, truncated after the layer `end`, with a copy of the layer
    `graft` appended, as in the engine. Layers that the outputs do not need are left out.
    """
    found = proto.resolve(net.SerializeToString()).pruned(end, graft)
    layers = [Layer(node.name, node.type, None if node.index < 0 else net.layer[node.index], node.inputs, node.outputs)
              for node in found.nodes]
    return Graph(layers, [blob for blob, _ in found.values], found.outputs)
