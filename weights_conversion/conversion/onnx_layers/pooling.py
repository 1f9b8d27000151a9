"""Caffe's pooling, exact for every input size.

Caffe has ceil((H + 2p - k) / s) + 1 windows; if some pad is not zero, one less if the last would start at or beyond H + p
(docs/reference/LAYERS.md point 1). The floor formula with pad p before and e = min(p + s - 1, k - 1) after gives the same number, so
ONNX's ceil mode is not needed, and e does not depend on H.
"""

import numpy as np

LOWEST = np.finfo(np.float32).min


def _axes(p):
    """Returns (kernel, stride, pad), each (rows, columns)."""
    kernel = (p.kernel_h, p.kernel_w) if p.HasField('kernel_h') else (p.kernel_size,) * 2
    stride = (p.stride_h, p.stride_w) if p.HasField('stride_h') else (p.stride,) * 2
    pad = (p.pad_h, p.pad_w) if p.HasField('pad_h') else (p.pad,) * 2
    return kernel, stride, pad


def _end(kernel, stride, pad, floor, clips):
    if floor:
        return pad
    end = pad + stride - 1
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
    return pool(g, site, p.pool == p.MAX, *_axes(p), floor)


def pool(g, site, is_max, kernel, stride, pad, floor=False):
    """Adds the nodes of a pooling with these windows."""
    end = tuple(_end(k, s, q, floor, any(pad)) for k, s, q in zip(kernel, stride, pad))
    sizes = dict(kernel_shape=kernel, strides=stride)
    if is_max:
        return _max(g, site, sizes, pad, end)
    return [_average(g, site, sizes, pad, end)]


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


def _average(g, site, sizes, pad, end):
    """Sum divided by the area of the window clipped to the padded image: padding counts, pixels beyond it do not."""
    pads, x = (*pad, *end), site.x[0]
    if pad == end:
        return g.node('AveragePool', x, pads=pads, count_include_pad=1, **sizes)
    kernel = sizes['kernel_shape']
    gaps = any(e >= k for e, k in zip(end, kernel))  # a window may be empty, which AveragePool rejects
    if not any(pad) and not gaps:
        return g.node('AveragePool', x, pads=pads, count_include_pad=0, **sizes)
    if gaps:
        planes = g.reshape(x, -1, 1, g.shape(x, 2))
        sums = g.node('Conv', planes, g.constant(np.ones((1, 1, *kernel))), pads=pads, **sizes)
        sums = g.reshape(sums, g.shape(x, 0, 2), g.shape(sums, 2))
    else:
        means = g.node('AveragePool', x, pads=pads, count_include_pad=1, **sizes)
        sums = g.affine(means, float(np.prod(kernel)))
    return g.node('Div', sums, _area(g, x, sums, sizes, pad))


def _area(g, x, y, sizes, pad):
    """Returns Caffe's areas of the windows of y, [rows][columns]; 0 or negative beyond the image."""
    lengths = []
    for axis, kernel, stride, before in zip((2, 3), sizes['kernel_shape'], sizes['strides'], pad):
        n_windows = g.reshape(g.shape(y, axis, axis + 1))
        steps = g.node('Range', g.constant(0, np.int64), n_windows, g.constant(1, np.int64))
        begin = g.node('Sub', g.node('Mul', steps, g.integers(stride)), g.integers(before))
        last = g.node('Add', g.shape(x, axis, axis + 1), g.integers(before))
        stop = g.node('Min', g.node('Add', begin, g.integers(kernel)), last)
        lengths.append(g.to_float(g.node('Sub', stop, begin)))
    return g.node('Mul', g.reshape(lengths[0], -1, 1), lengths[1])


def _spp(g, site):
    p, (_, _, h, w) = site.message.spp_param, site.shapes[0]
    if not site.fixed:
        site.refuse('windows depend on the input size; export with --fixed')
    levels = []
    for level in range(p.pyramid_height):
        bins = 2**level
        kernel = tuple(-(-size // bins) for size in (h, w))
        pad = tuple((k * bins - size + 1) // 2 for k, size in zip(kernel, (h, w)))
        levels += pool(g, site, p.pool == p.MAX, kernel, kernel, pad)
    if len(levels) == 1:
        return levels
    return [g.node('Concat', *(g.reshape(level, 0, -1) for level in levels), axis=1)]


EMIT = {'Pooling': _pooling, 'SPP': _spp}
