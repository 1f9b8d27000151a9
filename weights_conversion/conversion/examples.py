"""Example inputs for comparisons."""

import re

import numpy as np

from .errors import UsageError
from .npy import read_npy

# Layer type -> positions of inputs that are indices or indicators, for which random numbers are invalid.
SPECIAL = {'BatchReindex': {1}, 'Embed': {0}, 'Filter': {-1}, 'LSTM': {1}, 'Lstm': {1}, 'RNN': {1}, 'ROIPooling': {1}}


def inputs_of(graph):
    """Returns the inputs of a graph, {blob: shape}; the shape is None if the file has none."""
    found = {}
    for layer in graph.layers:
        if layer.type != 'Input':
            continue
        shapes = [tuple(shape.dim) for shape in layer.message.input_param.shape]
        for i, blob in enumerate(layer.message.top):
            found[blob] = shapes[i if len(shapes) > 1 else 0] if shapes else None
    return found


def arrays(graph, shape_options, array_options):
    """Returns {blob: float32 array} for every input: given arrays, else random numbers of the given shape or the file's.

    shape_options: list of '[BLOB=]1x3x227x227'. array_options: list of '[BLOB=]FILE.npy'.
    """
    known = inputs_of(graph)
    shapes = {blob: shape_of(text) for blob, text in _by_blob('--input-shape', shape_options, known).items()}
    files = _by_blob('--input', array_options, known)
    result = {}
    for i, (blob, shape) in enumerate(known.items()):
        if blob in files:
            result[blob] = read_npy(files[blob])
            continue
        _not_special(graph, blob)
        shape = shapes.get(blob, shape)
        if not shape:
            raise UsageError(f"input '{blob}' has no shape in the file; give it, e.g. --input-shape {blob}=1x3x227x227")
        result[blob] = random(shape, seed=i)
    return result


def random(shape, seed=0):
    """Returns normally distributed float32 numbers.

    Their standard deviation is between those of usual inputs: about 60 for pixels minus their mean, 1 for scaled pixels. With a
    much larger one, a softmax would amplify rounding; with a much smaller one, biases would dominate.
    """
    return np.random.default_rng(seed).normal(0, 10, shape).astype(np.float32)


def _by_blob(option, texts, known):
    result = {}
    for text in texts:
        blob, equals, value = text.partition('=')
        if not equals:
            if len(known) != 1:
                raise UsageError(f'{option} {text}: the net has {len(known)} inputs; name one: BLOB={text}')
            blob, value = next(iter(known)), text
        if blob not in known:
            raise UsageError(f"{option}: no input '{blob}' (the net has {', '.join(known) or 'none'})")
        result[blob] = value
    return result


def shape_of(text):
    """Parses '1x3x227x227'."""
    if not re.fullmatch(r'[1-9][0-9]{0,9}([x,][1-9][0-9]{0,9})*', text):
        raise UsageError(f"--input-shape: expected sizes like 1x3x227x227, found '{text}'")
    return tuple(map(int, re.split('[x,]', text)))


def _not_special(graph, blob):
    for layer in graph.layers:
        places = SPECIAL.get(layer.type, ())
        for place, value in enumerate(layer.inputs):
            if graph.blobs[value] == blob and (place in places or place - len(layer.inputs) in places):
                raise UsageError(f"input '{blob}' has indices or indicators for '{layer.name}' ({layer.type}); "
                                 f'give --input {blob}=FILE.npy')
