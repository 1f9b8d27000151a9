"""Layers and blobs of a net with pycaffe's names."""

from collections import Counter

from .. import proto
from ..engine import layer_types
from ..errors import InputError
from ._blob import BlobVec


class Layer:
    """A layer: name, type, names of inputs (bottoms) and outputs (tops), and weights (blobs)."""

    def __init__(self, name, type_, bottoms, tops, message=None):
        self.name = name
        self.type = type_
        self.bottoms = list(bottoms)
        self.tops = list(tops)
        self.message = message  # None for an inserted Split
        self.blobs = BlobVec()
        self.script = None  # object that runs a layer of a type in IN_PYTHON


IN_PYTHON = ('DummyData', 'Python')  # layer types that run in _scripts instead of the engine


def with_splits(net, prototxt):
    """Inserts Caffe's Split layers.

    If several layers read a blob, Caffe inserts a Split layer after its writer, and each reader gets a copy. Names of Split
    layer and copies consist of the names of blob and layer and the index of the output.

    net: NetParameter. prototxt: file name for messages.
    Returns the layers, a dict from names of copies to names of the original blobs, and one from names of blobs to names of
    earlier blobs that have the same memory. Raises InputError if a layer reads a blob that no earlier layer writes.
    """
    messages = list(net.layer)
    graph = proto.resolve(net.SerializeToString())
    values = graph.values
    outputs = {}  # value -> (layer, top)
    sources = {}  # (layer, bottom) -> (layer, top)
    views = {}
    for node in graph.nodes:
        if node.index < 0:  # shows the same blob again
            outputs[node.outputs[0]] = outputs[node.inputs[1]]
            continue
        message = messages[node.index]
        for j, value in enumerate(node.inputs):
            if value < 0:
                raise InputError(
                    f"{prototxt}: layer '{message.name}' reads '{message.bottom[j]}', which no layer before it writes"
                )
            sources[node.index, j] = outputs[value]
        for j, value in enumerate(node.outputs):
            outputs[value] = node.index, j
            if node.inputs and values[value][1] == values[node.inputs[0]][1] and message.top[j] != message.bottom[0]:
                views[message.top[j]] = message.bottom[0]
    reads = Counter(sources.values())  # (layer, top) -> number of readers
    for i, message in enumerate(messages):
        for j, weight in enumerate(message.loss_weight[: len(message.top)]):
            if weight:  # a loss counts as the first reader
                reads[i, j] += 1

    def split_name(source):
        layer, top = source
        return f'{messages[layer].top[top]}_{messages[layer].name}_{top}_split'

    layers, copies = [], {}
    given = Counter()  # (layer, top) -> copies that have a reader
    for i, message in enumerate(messages):
        bottoms = list(message.bottom)
        for j in range(len(bottoms)):
            source = sources[i, j]
            if reads[source] > 1:
                bottoms[j] = f'{split_name(source)}_{given[source]}'
                given[source] += 1
        layers.append(Layer(message.name, message.type, bottoms, message.top, message))
        for j, blob in enumerate(message.top):
            if reads[i, j] <= 1:
                continue
            if j < len(message.loss_weight) and message.loss_weight[j]:
                given[i, j] += 1
            tops = [f'{split_name((i, j))}_{k}' for k in range(reads[i, j])]
            layers.append(Layer(split_name((i, j)), 'Split', [blob], tops))
            copies.update((top, blob) for top in tops)
    return layers, copies, views


def outputs(layers):
    """Returns the blobs that no layer reads, sorted by name as in Caffe."""
    unread = set()
    for layer in layers:
        unread.difference_update(layer.bottoms)
        unread.update(layer.tops)
    return sorted(unread)


def computing(layers):
    """Returns the layers that the engine computes. It skips losses and layers of unknown types, such as HDF5Output, without an output."""
    known = layer_types()
    return [layer for layer in layers if layer.message is not None and layer.type not in ('Input', *IN_PYTHON)
            and (layer.tops or layer.type in known and not layer.type.endswith('Loss'))]


def steps(layers, first, last):
    """Yields the execution steps of layers first to last, inclusive: index ranges for the engine, or layers of _scripts."""
    begin = first
    for i in range(first, last + 1):
        if layers[i].type not in IN_PYTHON:
            continue
        if begin < i:
            yield begin, i - 1
        yield layers[i]
        begin = i + 1
    if begin <= last:
        yield begin, last
