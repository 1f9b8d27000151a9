"""Convolution and inner product layers."""

import numpy as np


def _per_axis(field, n, absent):
    values = list(field) or [absent]
    return values * n if len(values) == 1 else values


def _sizes(p, n):
    """Returns (kernel, stride, pad, dilation), each a list over the n spatial axes; if n is 0, over the axis of _each_input."""
    if n == 0:
        return [1], [1], [0], [1]
    def of(name, repeated, absent):
        if p.HasField(f'{name}_h') or p.HasField(f'{name}_w'):
            return [getattr(p, f'{name}_h'), getattr(p, f'{name}_w')]
        return _per_axis(repeated, n, absent)
    return (of('kernel', p.kernel_size, 0), of('stride', p.stride, 1), of('pad', p.pad, 0),
            _per_axis(p.dilation, n, 1))


def trailing(p, pad):
    """Returns the pads behind each axis, which differ from those before it only if pad_b and pad_r are given."""
    return [p.pad_b, p.pad_r] if p.HasField('pad_b') else list(pad)


def _each_input(g, site, compute):
    """Applies the layer to each of its inputs. Axes before the channels are batch axes.

    Without spatial axes, adds one of size 1, which ONNX needs.
    """
    axis, shape = site.axis(site.message.convolution_param.axis), site.shapes[0]
    spatial = shape[axis + 1:]
    outputs = []
    for x in site.x:
        batch = None
        if axis != 1 or not spatial:
            batch = g.shape(x, 0, axis)
            x = g.reshape(x, -1, g.shape(x, axis)) if spatial else g.reshape(x, -1, shape[axis], 1)
        y = compute(x, spatial, shape[axis])
        outputs.append(y if batch is None else g.reshape(y, batch, g.shape(y, 1, None if spatial else 2)))
    return outputs


def _bias(g, site, p):
    return [g.constant(site.blobs[1].ravel())] if p.bias_term else []


def _convolution(g, site):
    p = site.message.convolution_param

    def compute(x, spatial, channels):
        kernel, stride, pad, dilation = _sizes(p, len(spatial))
        group = channels if site.layer.type in ('ConvolutionDepthwise', 'DepthwiseConvolution') else p.group
        weights = g.constant(site.blobs[0].reshape(p.num_output, channels // group, *kernel))
        return g.node('Conv', x, weights, *_bias(g, site, p), kernel_shape=kernel, strides=stride,
                      pads=_pads(site, spatial, kernel, stride, pad, dilation), dilations=dilation, group=group)
    return _each_input(g, site, compute)


def _pads(site, spatial, kernel, stride, pad, dilation):
    """Returns the pads. With a single window, Caffe's kernel may exceed the padded input by less than a stride, over zeros."""
    ends = []
    for size, k, s, q, e, d in zip(spatial or (1,), kernel, stride, pad, trailing(site.message.convolution_param, pad), dilation):
        missing = (k - 1) * d + 1 - size - q - e
        if missing > 0 and not site.fixed:
            site.refuse(f'expected a kernel of at most {size} + {q + e}, found {k}; export with a larger input, or --fixed')
        ends.append(e + max(missing, 0))
    return [*pad, *ends]


def _deconvolution(g, site):
    p = site.message.convolution_param

    def compute(x, spatial, channels):
        kernel, stride, pad, dilation = _sizes(p, len(spatial))
        weights = g.constant(site.blobs[0].reshape(channels, p.num_output // p.group, *kernel))
        return g.node('ConvTranspose', x, weights, *_bias(g, site, p), kernel_shape=kernel, strides=stride,
                      pads=pad + trailing(p, pad), dilations=dilation, group=p.group)
    return _each_input(g, site, compute)


def _im2col(g, site):
    """Every window position becomes a channel, by convolving each channel with one-hot kernels."""
    p = site.message.convolution_param

    def compute(x, spatial, channels):
        kernel, stride, pad, dilation = _sizes(p, len(spatial))
        taps = int(np.prod(kernel))
        one_hot = np.eye(taps, dtype=np.float32).reshape(taps, 1, *kernel)
        y = g.node('Conv', g.reshape(x, -1, 1, g.shape(x, 2)), g.constant(one_hot), kernel_shape=kernel, strides=stride,
                   pads=_pads(site, spatial, kernel, stride, pad, dilation), dilations=dilation)
        return g.reshape(y, g.shape(x, 0, 1), -1, g.shape(y, 2))
    return _each_input(g, site, compute)


def _inner_product(g, site):
    p = site.message.inner_product_param
    axis, rank, n = site.axis(p.axis), len(site.shapes[0]), p.num_output
    x = site.x[0] if (axis, rank) == (1, 2) else g.node('Flatten', site.x[0], axis=axis)
    weights = site.blobs[0].reshape((-1, n) if p.transpose else (n, -1))
    y = g.node('Gemm', x, g.constant(weights), *_bias(g, site, p), transB=0 if p.transpose else 1)
    if axis == 1:
        return [y]
    return [g.reshape(y, g.shape(site.x[0], 0, axis), n) if axis else g.reshape(y, n)]


def _roi_pooling(g, site):
    p = site.message.roi_pooling_param
    if p.pad_ratio:
        site.refuse("pad_ratio is not supported by ONNX's MaxRoiPool")
    return [g.node('MaxRoiPool', *site.x, pooled_shape=[p.pooled_h, p.pooled_w], spatial_scale=p.spatial_scale)]


EMIT = {'Convolution': _convolution, 'ConvolutionDepthwise': _convolution, 'Deconvolution': _deconvolution,
        'DepthwiseConvolution': _convolution, 'Im2col': _im2col, 'InnerProduct': _inner_product,
        'ROIPooling': _roi_pooling}
