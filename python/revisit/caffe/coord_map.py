"""Coordinate maps between outputs of a NetSpec, for cropping one to another.

A map is (axis, scale, shift): along every axis from `axis` + 1 on, pixel i of a layer's input is at i * scale + shift of its
output. The axis None denotes a pointwise layer. Scale and shift are numbers, or arrays with one number per axis.
"""

import numpy as np

from .net_spec import layers

PASS_THROUGH_LAYERS = [
    'AbsVal', 'BatchNorm', 'Bias', 'BNLL', 'Dropout', 'Eltwise', 'ELU', 'Log', 'LRN', 'Exp', 'MVN', 'Power', 'ReLU', 'PReLU',
    'Scale', 'Sigmoid', 'Split', 'TanH', 'Threshold',
]  # fmt: skip
IDENTITY = (None, 1, 0)


class UndefinedMapException(Exception):
    """The layer has no coordinate map."""


class AxisMismatchException(Exception):
    """Two maps start at different axes."""


def _numbers(params, name, default):
    return np.array(params.get(name, default), ndmin=1)


def conv_params(fn):
    """Returns (axis, stride, kernel extent, pad) of a Convolution, Deconvolution, Im2col or Pooling."""
    params = fn.params.get('convolution_param', fn.params)
    by_axis = {f'{what}_{side}' for what in ('pad', 'kernel', 'stride') for side in 'hw'}
    assert not by_axis & set(fn.params), 'cropping does not support legacy _h/_w params'
    extent = (_numbers(params, 'kernel_size', params['kernel_size']) - 1) * _numbers(params, 'dilation', 1) + 1
    return params.get('axis', 1), _numbers(params, 'stride', 1), extent, _numbers(params, 'pad', 0)


def crop_params(fn):
    """Returns (axis, offset) of a Crop."""
    params = fn.params.get('crop_param', fn.params)
    return params.get('axis', 2), _numbers(params, 'offset', 0)


def coord_map(fn):
    """Returns the map of a layer. Raises UndefinedMapException if it has none."""
    if fn.type_name in PASS_THROUGH_LAYERS:
        return IDENTITY
    if fn.type_name == 'Crop':
        axis, offset = crop_params(fn)
        return axis - 1, 1, -offset
    if fn.type_name not in ('Convolution', 'Deconvolution', 'Im2col', 'Pooling'):
        raise UndefinedMapException(fn.type_name)
    axis, stride, extent, pad = conv_params(fn)
    if fn.type_name == 'Deconvolution':
        return axis, stride, (extent - 1) / 2 - pad
    return axis, 1 / stride, (pad - (extent - 1) / 2) / stride


def compose(base_map, next_map):
    """Returns the map that applies next_map, then base_map. Raises AxisMismatchException if their axes differ."""
    (axis, scale, shift), (next_axis, next_scale, next_shift) = base_map, next_map
    if None not in (axis, next_axis) and axis != next_axis:
        raise AxisMismatchException(f'{axis} and {next_axis}')
    return next_axis if axis is None else axis, scale * next_scale, scale * next_shift + shift


def inverse(coord_map):
    """Returns the inverse map."""
    axis, scale, shift = coord_map
    return axis, 1 / scale, -shift / scale


def _ancestors(top):
    """Yields (output, map from it to `top`) of `top` and all outputs that it depends on, the last first."""
    maps, waiting = {top: IDENTITY}, [top]
    while waiting:
        top = waiting.pop()
        yield top, maps[top]
        try:
            step = coord_map(top.fn)
        except UndefinedMapException:
            continue
        # Only the size of a Crop's second input is used.
        for source in top.fn.inputs[: 1 if top.fn.type_name == 'Crop' else None]:
            if source not in maps:
                maps[source] = compose(maps[top], step)
                waiting.append(source)


def coord_map_from_to(top_from, top_to):
    """Returns the map from one output to another through a common ancestor.

    Raises:
        RuntimeError: there is no common ancestor, or a layer in between has no map.
    """
    from_maps = dict(_ancestors(top_from))
    for top, map_ in _ancestors(top_to):
        if top in from_maps:
            return compose(map_, inverse(from_maps[top]))
    raise RuntimeError('Could not compute map between tops; are they connected by spatial layers?')


def crop(top_from, top_to):
    """Returns a Crop layer that crops `top_from` to the extent of `top_to`.

    Raises:
        AssertionError: their pixels are not aligned, or `top_to` extends beyond `top_from`.
    """
    axis, scale, shift = coord_map_from_to(top_from, top_to)
    axis, shift = 1 if axis is None else axis, np.atleast_1d(shift)
    assert np.all(scale == 1), f'scale mismatch on crop (a = {scale})'
    assert (shift <= 0).all(), f'cannot crop negative offset (b = {shift})'
    assert (np.round(shift) == shift).all(), f'cannot crop noninteger offset (b = {shift})'
    return layers.Crop(top_from, top_to, crop_param=dict(axis=axis + 1, offset=[int(-offset) for offset in shift]))
