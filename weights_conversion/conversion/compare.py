"""Comparison of outputs of two networks, and example inputs for it."""

import re

import numpy as np

from revisit.errors import Error, UsageError

from .files import read_npy

TOLERANCE = 1e-4  # relative to the maximum of an output: Winograd convolutions of libraries differ by this much


class CheckFailed(Error):
    """Outputs of the converted network differ from the original's."""

    code = 5


def difference(found, expected):
    """Returns max|found - expected| / max|expected|; infinite if shapes or positions of NaN and infinity differ."""
    found, expected = np.asarray(found, np.float64), np.asarray(expected, np.float64)
    if found.shape != expected.shape:
        return np.inf
    finite = np.isfinite(expected)
    if not np.array_equal(found[~finite], expected[~finite], equal_nan=True) or not np.isfinite(found[finite]).all():
        return np.inf
    largest = np.abs(expected[finite]).max(initial=0)
    worst = np.abs(found[finite] - expected[finite]).max(initial=0)
    return worst / largest if largest > 0 else worst


def require(what, found, expected, tolerance=None):
    """Prints the largest difference of all outputs. Raises CheckFailed if it exceeds the tolerance, TOLERANCE by default.

    found, expected: output name -> array.
    """
    tolerance = TOLERANCE if tolerance is None else tolerance
    for name in expected:
        if name not in found:
            raise CheckFailed(f"check failed: {what}: output '{name}' is missing")
    if not expected:
        raise CheckFailed(f'check failed: {what}: no outputs to compare')
    differences = {name: difference(found[name], array) for name, array in expected.items()}
    name = max(differences, key=differences.get)
    shape = 'x'.join(map(str, expected[name].shape)) or 'a number'
    if not differences[name] <= tolerance:
        found_shape = 'x'.join(map(str, found[name].shape)) or 'a number'
        raise CheckFailed(f"check failed: {what}: output '{name}' ({shape}) differs by {differences[name]:.2g} of its maximum "
                          f'(tolerance {tolerance:g})' + (f', found shape {found_shape}' if found_shape != shape else ''))
    print(f"checked: {what}: largest difference {differences[name]:.2g} (output '{name}', {shape})")


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


def arrays(graph, given):
    """Returns {blob: float32 array} for every input: given arrays, else random numbers of the given shape or the file's.

    given: list of '[BLOB=]1x3x227x227' and '[BLOB=]FILE.npy'.
    """
    known, result = inputs_of(graph), {}
    given = _by_blob(given, known)
    for i, (blob, shape) in enumerate(known.items()):
        value = given.get(blob, '')
        if value.endswith('.npy'):
            result[blob] = read_npy(value)
            continue
        _not_special(graph, blob)
        shape = shape_of(value) if value else shape
        if not shape:
            raise UsageError(f"input '{blob}' has no shape in the file; give it, e.g. --input {blob}=1x3x227x227")
        result[blob] = random(shape, seed=i)
    return result


def random(shape, seed=0):
    """Returns normally distributed float32 numbers.

    Their standard deviation is between those of usual inputs: about 60 for pixels minus their mean, 1 for scaled pixels. With a
    much larger one, a softmax would amplify rounding; with a much smaller one, biases would dominate.
    """
    return np.random.default_rng(seed).normal(0, 10, shape).astype(np.float32)


def _by_blob(texts, known):
    result = {}
    for text in texts:
        blob, equals, value = text.partition('=')
        if not equals:
            if len(known) != 1:
                raise UsageError(f'--input {text}: the net has {len(known)} inputs; name one: BLOB={text}')
            blob, value = next(iter(known)), text
        if blob not in known:
            raise UsageError(f"--input: no input '{blob}' (the net has {', '.join(known) or 'none'})")
        result[blob] = value
    return result


def shape_of(text):
    """Parses '1x3x227x227'."""
    if not re.fullmatch(r'[1-9][0-9]{0,9}([x,][1-9][0-9]{0,9})*', text):
        raise UsageError(f"--input: expected sizes like 1x3x227x227, or FILE.npy, found '{text}'")
    return tuple(map(int, re.split('[x,]', text)))


def _not_special(graph, blob):
    for layer in graph.layers:
        places = SPECIAL.get(layer.type, ())
        for place, value in enumerate(layer.inputs):
            if graph.blobs[value] == blob and (place in places or place - len(layer.inputs) in places):
                raise UsageError(f"input '{blob}' has indices or indicators for '{layer.name}' ({layer.type}); "
                                 f'give --input {blob}=FILE.npy')
