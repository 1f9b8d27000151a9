"""Layers that sum over many values: normalization, softmax, reductions."""

import numpy as np

from ..graph import is_of_batch, statistics


def _batch_norm(g, site):
    p, rank = site.message.batch_norm_param, len(site.shapes[0])
    blobs = [blob.ravel() for blob in site.blobs]
    if is_of_batch(site.message):
        y = _normalized_by_batch(g, site.x[0], rank, p.eps)
        if len(blobs) < 5:
            return [y]
        beside = [-1] + [1] * (rank - 2)
        return [g.node('Add', g.node('Mul', y, g.constant(blobs[3].reshape(beside))), g.constant(blobs[4].reshape(beside)))]
    mean, variance, scale, bias, eps = statistics(p, blobs)
    return [g.node('BatchNormalization', site.x[0], *map(g.constant, (scale, bias, mean, variance)), epsilon=eps)]


def _bn(g, site):
    p, rank = site.message.bn_param, len(site.shapes[0])
    scale, shift, *statistics = (blob.ravel() for blob in site.blobs)
    if not statistics and p.bn_mode == p.LEARN:
        beside = [-1] + [1] * (rank - 2)
        scaled = g.node('Mul', _normalized_by_batch(g, site.x[0], rank, 1e-9), g.constant(scale.reshape(beside)))
        return [g.node('Add', scaled, g.constant(shift.reshape(beside)))]
    mean, variance = statistics or (np.zeros_like(scale), np.ones_like(scale))
    return [g.node('BatchNormalization', site.x[0], *map(g.constant, (scale, shift, mean, variance)),
                   epsilon=p.eps if statistics else 0.0)]


def _normalized_by_batch(g, x, rank, eps):
    centered, variance = _centered(g, x, [axis for axis in range(rank) if axis != 1])
    return g.node('Div', centered, g.node('Sqrt', g.affine(variance, shift=eps)))


def _centered(g, x, axes):
    """Returns x minus its mean over `axes`, and its variance.

    Reduces axis by axis, because ONNX Runtime sums several axes sequentially, which loses precision.
    """
    def mean(y):
        for axis in reversed(axes):
            y = g.node('ReduceMean', y, axes=[axis], keepdims=1)
        return y
    centered = g.node('Sub', x, mean(x))
    return centered, mean(g.node('Mul', centered, centered))


def _mvn(g, site):
    p, rank = site.message.mvn_param, len(site.shapes[0])
    first = min(1 if p.across_channels else 2, rank)
    x = site.x[0] if rank == 4 else g.reshape(site.x[0], *[0] * rank, *[1] * (4 - rank))
    if first == rank:  # every value is its own mean
        return [g.node('Sub', x, x)]
    centered, variance = _centered(g, x, list(range(first, rank)))
    if not p.normalize_variance:
        return [centered]
    return [g.node('Div', centered, g.affine(g.node('Sqrt', variance), shift=p.eps))]


def _lrn(g, site):
    p = site.message.lrn_param
    across, side, pad = p.norm_region == p.ACROSS_CHANNELS, p.local_size, p.local_size // 2
    if across and p.alpha > 0 and p.beta > 0:  # ONNX Runtime's LRN requires positive values
        return [g.node('LRN', site.x[0], size=side, alpha=p.alpha, beta=p.beta, bias=p.k)]
    squares = g.node('Mul', site.x[0], site.x[0])
    if across:  # treats channels as rows of one image
        rows = g.reshape(squares, g.shape(squares, 0, 1), 1, g.shape(squares, 1, 2), -1)
        means = g.node('AveragePool', rows, kernel_shape=[side, 1], pads=[pad, 0] * 2, count_include_pad=1)
        means = g.reshape(means, g.shape(squares))
    else:
        means = g.node('AveragePool', squares, kernel_shape=[side, side], pads=[pad] * 4, count_include_pad=1)
    scale = g.affine(means, p.alpha, p.k if across else 1)
    return [g.node('Mul', site.x[0], g.node('Pow', scale, g.constant(-p.beta)))]


def _normalize(g, site):
    p, rank = site.message.norm_param, len(site.shapes[0])
    of_pixels = not site.blobs  # NormFace's
    axes = list(range(1, rank)) if p.across_spatial and not of_pixels else [1]
    eps = p.eps if site.message.HasField('norm_param') or not of_pixels else 1e-6
    norm = g.node('Sqrt', g.affine(g.node('ReduceSumSquare', site.x[0], axes=axes, keepdims=1), shift=eps))
    if of_pixels:
        return [g.node('Div', site.x[0], norm)]
    scale = site.blobs[0].ravel().reshape((-1,) + (1,) * (rank - 2))
    return [g.node('Mul', g.node('Div', site.x[0], norm), g.constant(scale))]


def _softmax(g, site):
    return [g.node('Softmax', site.x[0], axis=site.message.softmax_param.axis)]


def _reduction(g, site):
    p = site.message.reduction_param
    axis = site.axis(p.axis)
    rows = g.reshape(site.x[0], *[0] * axis, -1)
    if p.operation == p.SUM:
        y = g.node('ReduceSum', rows, g.integers(axis), keepdims=0)
    else:
        op = {p.ASUM: 'ReduceL1', p.SUMSQ: 'ReduceSumSquare', p.MEAN: 'ReduceMean'}[p.operation]
        y = g.node(op, rows, axes=[axis], keepdims=0)
    return [g.affine(y, p.coeff)]


EMIT = {'BatchNorm': _batch_norm, 'BN': _bn, 'LRN': _lrn, 'MVN': _mvn, 'Normalize': _normalize, 'Reduction': _reduction,
        'Softmax': _softmax}
