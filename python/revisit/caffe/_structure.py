"""Layers and blobs of a net with pycaffe's names."""

from collections import Counter

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


def with_splits(messages, prototxt):
    """Inserts Caffe's Split layers.

    If several layers read a blob, Caffe inserts a Split layer after its writer, and each reader gets a copy. Names of Split
    layer and copies consist of the names of blob and layer and the index of the output.

    messages: LayerParameter of every layer, in order.
    prototxt: file name for messages.
    Returns the layers, and a dict from names of copies to names of the original blobs. Raises InputError if a layer reads a
    blob that no earlier layer writes.
    """
    messages = list(messages)
    writer = {}  # blob -> (layer, top) that wrote it last
    reads = Counter()  # (layer, top) -> number of readers
    sources = {}  # (layer, bottom) -> (layer, top)
    for i, message in enumerate(messages):
        for j, blob in enumerate(message.bottom):
            if blob not in writer:
                raise InputError(
                    f"{prototxt}: layer '{message.name}' reads '{blob}', which no layer before it writes"
                )
            sources[i, j] = writer[blob]
            reads[writer[blob]] += 1
        for j, blob in enumerate(message.top):
            writer[blob] = (i, j)
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
    return layers, copies


def shares_memory(message):
    """Returns True if the tops share the memory of the first bottom in Caffe. Must match engine/src/graph.cpp."""
    if message.type == 'Concat':
        return len(message.bottom) == 1
    if message.type == 'Slice':
        return len(message.top) == 1
    if message.type == 'Permute':
        return list(message.permute_param.order) == list(range(len(message.permute_param.order)))
    return message.type in ('Split', 'Flatten', 'Reshape')


def views(layers):
    """Returns top -> layer, for layers of the file whose tops share the memory of their first bottom."""
    found = {}
    for layer in layers:
        if layer.message is not None and layer.bottoms and shares_memory(layer.message):
            found.update((top, layer) for top in layer.tops if top != layer.message.bottom[0])
    return found


def blob_names(layers):
    """Blobs in the order of their first writers."""
    return list(dict.fromkeys(top for layer in layers for top in layer.tops))


def outputs(layers):
    """Returns the blobs that no layer reads, sorted by name as in Caffe."""
    unread = set()
    for layer in layers:
        unread.difference_update(layer.bottoms)
        unread.update(layer.tops)
    return sorted(unread)


def inputs(layers):
    return [top for layer in layers if layer.type == 'Input' for top in layer.tops]


def computing(layers):
    return [layer for layer in layers if layer.message is not None and layer.type not in ('Input', *IN_PYTHON)]


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
