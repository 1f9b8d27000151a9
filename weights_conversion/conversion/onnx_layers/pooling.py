"""Caffe's pooling, exact for every input size.

Caffe has ceil((H + p + a - k) / s) + 1 windows (a: pad after); if some pad is not zero, one less if the last would start at or beyond H + p
(docs/reference/LAYERS.md point 1). The floor formula with pad p before and e = min(a + s - 1, k - 1) after gives the same number, so
ONNX's ceil mode is not needed, and e does not depend on H.
"""

import numpy as np

from .windows import trailing

LOWEST = np.finfo(np.float32).min


def _axes(p):
    """Returns (kernel, stride, pad), each (rows, columns)."""
    kernel = (p.kernel_h, p.kernel_w) if p.HasField('kernel_h') else (p.kernel_size,) * 2
    stride = (p.stride_h, p.stride_w) if p.HasField('stride_h') else (p.stride,) * 2
    pad = (p.pad_h, p.pad_w) if p.HasField('pad_h') else (p.pad,) * 2
    return kernel, stride, pad


def _end(kernel, stride, after, floor, clips):
    """Returns the pad behind an axis that gives the floor formula as many windows as Caffe has, with the pad `after` there."""
    end = after if floor else after + stride - 1
    return min(end, kernel - 1) if clips else end


def _pooling(g, site):
    p = site.message.pooling_param
    if p.global_pooling:
        y = g.node('GlobalMaxPool' if p.pool == p.MAX else 'GlobalAveragePool', site.x[0])
        if len(site.layer.outputs) == 1:
            return [y]
        place = g.node('ArgMax', g.reshape(site.x[0], 0, 0, -1), axis=2)
        return [y, g.to_float(g.node('Unsqueeze', place, g.integers(3)))]
    if len(site.shapes[0]) != 4:
        site.refuse('pooling of volumes cannot be exported to ONNX')
    floor = not p.ceil_mode if p.HasField('ceil_mode') else p.round_mode == p.FLOOR
    kernel, stride, pad = _axes(p)
    return pool(g, site, p.pool == p.MAX, kernel, stride, pad, trailing(p, pad), floor, p.pool != p.AVE_EXC_PAD)


def pool(g, site, is_max, kernel, stride, pad, after, floor=False, counts_padding=True):
    """Adds the nodes of a pooling with these windows, with the pad `pad` before and `after` behind each axis."""
    clips = any(pad) or any(after)
    end = tuple(_end(k, s, a, floor, clips) for k, s, a in zip(kernel, stride, after))
    sizes = dict(kernel_shape=kernel, strides=stride)
    if is_max:
        return _max(g, site, sizes, pad, end)
    return [_average(g, site, sizes, pad, end, after if counts_padding else None)]


def _max(g, site, sizes, pad, end):
    x, before = site.x[0], pad
    gaps = any(e >= k for e, k in zip(end, sizes['kernel_shape']))  # a window may be empty
    if gaps:
        x, pad, end = g.pad(x, pad, end, LOWEST), (0, 0), (0, 0)
    if len(site.layer.outputs) == 1:
        return [g.node('MaxPool', x, pads=(*pad, *end), **sizes)]
    y, places = g.node('MaxPool', x, pads=(*pad, *end), n_outputs=2, **sizes)
    pixels = g.node('ReduceProd', g.shape(x, 2, 4), axes=[0], keepdims=1)
    places = g.node('Mod', places, pixels)  # indices within the plane instead of the array
    return [y, g.to_float(_unpadded(g, site.x[0], x, places, before) if gaps else places)]


def _unpadded(g, x, padded, places, before):
    """Converts indices in planes of `padded` to indices in planes of x; -1 outside of x, as in Caffe."""
    width = g.shape(padded, 3, 4)
    axes = [g.node(op, places, width) for op in ('Div', 'Mod')]
    inside = []
    for axis in (0, 1):
        axes[axis] = g.node('Sub', axes[axis], g.integers(before[axis]))
        inside += [g.node('Greater', axes[axis], g.integers(-1)), g.node('Less', axes[axis], g.shape(x, 2 + axis, 3 + axis))]
    while len(inside) > 1:
        inside = [g.node('And', *inside[:2]), *inside[2:]]
    place = g.node('Add', g.node('Mul', axes[0], g.shape(x, 3, 4)), axes[1])
    return g.node('Where', inside[0], place, g.integers(-1))


def _average(g, site, sizes, pad, end, after):
    """Sum divided by the area of the window clipped to the image with its pads; to the image alone if `after` is None."""
    pads, x, kernel = (*pad, *end), site.x[0], sizes['kernel_shape']
    if after and all(e <= a for e, a in zip(end, after)):
        return g.node('AveragePool', x, pads=pads, count_include_pad=1, **sizes)
    gaps = any(e >= k for e, k in zip(end, kernel))  # a window may be empty, which AveragePool rejects
    if not gaps and not (after and (any(pad) or any(after))):
        return g.node('AveragePool', x, pads=pads, count_include_pad=0, **sizes)
    if gaps:
        planes = g.reshape(x, -1, 1, g.shape(x, 2))
        sums = g.node('Conv', planes, g.constant(np.ones((1, 1, *kernel))), pads=pads, **sizes)
        sums = g.reshape(sums, g.shape(x, 0, 2), g.shape(sums, 2))
    else:
        means = g.node('AveragePool', x, pads=pads, count_include_pad=1, **sizes)
        sums = g.affine(means, float(np.prod(kernel)))
    return g.node('Div', sums, _area(g, x, sums, sizes, pad, after))


def _area(g, x, y, sizes, pad, after):
    """Returns Caffe's areas of the windows of y, [rows][columns]; beyond the image at most 0, or 1 if padding does not count."""
    lengths = []
    for axis, kernel, stride, before, behind in zip((2, 3), sizes['kernel_shape'], sizes['strides'], pad, after or (0, 0)):
        n_windows = g.reshape(g.shape(y, axis, axis + 1))
        steps = g.node('Range', g.constant(0, np.int64), n_windows, g.constant(1, np.int64))
        begin = g.node('Sub', g.node('Mul', steps, g.integers(stride)), g.integers(before))
        last = g.node('Add', g.shape(x, axis, axis + 1), g.integers(behind))
        stop = g.node('Min', g.node('Add', begin, g.integers(kernel)), last)
        if after is None:
            begin = g.node('Max', begin, g.integers(0))
        length = g.node('Sub', stop, begin)
        lengths.append(g.to_float(length if after else g.node('Max', length, g.integers(1))))
    return g.node('Mul', g.reshape(lengths[0], -1, 1), lengths[1])


def _spp(g, site):
    p, (_, _, h, w) = site.message.spp_param, site.shapes[0]
    site.require_fixed('windows depend on')
    levels = []
    for level in range(p.pyramid_height):
        bins = 2**level
        kernel = tuple(-(-size // bins) for size in (h, w))
        pad = tuple((k * bins - size + 1) // 2 for k, size in zip(kernel, (h, w)))
        levels += pool(g, site, p.pool == p.MAX, kernel, kernel, pad, pad)
    if len(levels) == 1:
        return levels
    return [g.node('Concat', *(g.reshape(level, 0, -1) for level in levels), axis=1)]


EMIT = {'Pooling': _pooling, 'SPP': _spp}
