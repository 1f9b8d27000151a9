"""Layers and blobs of a net by the names that pycaffe gives them."""

from collections import Counter

from ..errors import InputError
from ._blob import BlobVec


class Layer:
    """A layer: `name`, `type`, the names of its `bottoms` and `tops`, and its weights, `blobs`."""

    def __init__(self, name, type_, bottoms, tops, message=None):
        self.name = name
        self.type = type_
        self.bottoms = list(bottoms)
        self.tops = list(tops)
        self.message = message  # None: a Split that no file has
        self.blobs = BlobVec()
        self.script = None  # of a type in IN_PYTHON: the object that runs


IN_PYTHON = ('DummyData', 'Python')  # layer types that _scripts runs, not the engine


def with_splits(messages, prototxt):
    """The layers of a file with the Split layers that Caffe puts in.

    Where several layers read an array, Caffe inserts a Split layer behind the layer that wrote it, and each reader
    has a copy. Layer and copies have names made of the array's, the layer's and the index of the output.

    Args:
        messages: LayerParameter of every layer, in order.
        prototxt: the file's name, for messages.
    Returns:
        The layers, and a dict from the names of the copies to the names of what they are copies of.
    Raises:
        revisit.InputError: a layer reads what no layer before it writes.
    """
    messages = list(messages)
    writer = {}  # blob -> (layer, top) that wrote it last
    reads = Counter()  # of each (layer, top)
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
            if weight:  # a loss counts as a reader, the first one
                reads[i, j] += 1

    def split_name(source):
        layer, top = source
        return f'{messages[layer].top[top]}_{messages[layer].name}_{top}_split'

    layers, copies = [], {}
    given = Counter()  # copies that have a reader
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
    """Whether Caffe has the tops in the memory of the first bottom; engine/src/graph.cpp has the same."""
    if message.type == 'Concat':
        return len(message.bottom) == 1
    if message.type == 'Slice':
        return len(message.top) == 1
    if message.type == 'Permute':
        return list(message.permute_param.order) == list(range(len(message.permute_param.order)))
    return message.type in ('Split', 'Flatten', 'Reshape')


def views(layers):
    """The layers of the file whose tops share memory with their first bottom, by top."""
    found = {}
    for layer in layers:
        if layer.message is not None and layer.bottoms and shares_memory(layer.message):
            found.update((top, layer) for top in layer.tops if top != layer.message.bottom[0])
    return found


def blob_names(layers):
    """All blobs in the order in which layers first write them."""
    return list(dict.fromkeys(top for layer in layers for top in layer.tops))


def outputs(layers):
    """The blobs that no layer reads, sorted by name as Caffe has them."""
    unread = set()
    for layer in layers:
        unread.difference_update(layer.bottoms)
        unread.update(layer.tops)
    return sorted(unread)


def inputs(layers):
    """The tops of Input layers."""
    return [top for layer in layers if layer.type == 'Input' for top in layer.tops]


def computing(layers):
    """The layers that the engine runs, in order."""
    return [layer for layer in layers if layer.message is not None and layer.type not in ('Input', *IN_PYTHON)]


def steps(layers, first, last):
    """What layers first to last, inclusive, are run as: pairs of indices, and layers of _scripts."""
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
