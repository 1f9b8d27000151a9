"""NumPy reference of MatConvNet's layers, for the comparison."""

import numpy as np

from .matconvnet import filters_of


def forward(layers, x):
    """Returns the output of the layers of `matconvnet.load` for x [n][c][h][w]."""
    x = x.astype(np.float64)
    for layer in layers:
        x = COMPUTE[layer.type](layer, x)
    return x


def _windows(layer, x, h, w, value):
    """Returns the windows of the padded image, [n][c][rows][columns][h][w]."""
    top, bottom, left, right = layer.pad
    down, across = layer.stride
    padded = np.pad(x, ((0, 0), (0, 0), (top, bottom), (left, right)), constant_values=value)
    return np.lib.stride_tricks.sliding_window_view(padded, (h, w), axis=(2, 3))[:, :, ::down, ::across]


def _conv(layer, x):
    filters, biases = filters_of(layer)
    outputs, per_group, h, w = filters.shape
    dilate = layer.dilate[0]
    seen = _windows(layer, x, (h - 1) * dilate + 1, (w - 1) * dilate + 1, 0)[..., ::dilate, ::dilate]
    groups = x.shape[1] // per_group
    parts = [np.einsum('nchwij,ocij->nohw', seen[:, g * per_group:(g + 1) * per_group],
                       filters[g * outputs // groups:(g + 1) * outputs // groups], optimize=True) for g in range(groups)]
    y = np.concatenate(parts, axis=1)
    return y if biases is None else y + biases[:, None, None]


def _pool(layer, x):
    """Maximum or average over the pixels of the image, without padding."""
    if layer.method == 'max':
        return _windows(layer, x, *layer.pool, -np.inf).max(axis=(4, 5))
    sums = _windows(layer, x, *layer.pool, 0).sum(axis=(4, 5))
    return sums / _windows(layer, np.ones_like(x[:1, :1]), *layer.pool, 0).sum(axis=(4, 5))


def _lrn(layer, x):
    n, kappa, alpha, beta = layer.param
    before = int((n - 1) // 2)
    squares = np.pad(x * x, ((0, 0), (before, int(n) - 1 - before), (0, 0), (0, 0)))
    sums = np.lib.stride_tricks.sliding_window_view(squares, int(n), axis=1).sum(axis=-1)
    return x / (kappa + alpha * sums) ** beta


def _bnorm(layer, x):
    factor, shift = layer.arrays[0].reshape(-1, 1, 1), layer.arrays[1].reshape(-1, 1, 1)
    mean, deviation = layer.arrays[2].reshape(-1, 2).T.reshape(2, -1, 1, 1)
    return (x - mean) / deviation * factor + shift


def _softmax(layer, x):
    powers = np.exp(x - x.max(axis=1, keepdims=True))
    return powers / powers.sum(axis=1, keepdims=True)


COMPUTE = {
    'conv': _conv, 'pool': _pool, 'lrn': _lrn, 'normalize': _lrn, 'bnorm': _bnorm, 'dropout': lambda layer, x: x,
    'relu': lambda layer, x: np.where(x > 0, x, layer.leak * x), 'sigmoid': lambda layer, x: 1 / (1 + np.exp(-x)),
    'softmax': _softmax,
}
