"""Comparison of outputs of two networks."""

import numpy as np

from .errors import CheckFailed


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


def require(what, found, expected, tolerance):
    """Prints the largest difference of all outputs. Raises CheckFailed if it exceeds the tolerance.

    found, expected: output name -> array.
    """
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
