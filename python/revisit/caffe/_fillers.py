"""Initial values of weights that no file gives."""

import math

import numpy as np

from ..errors import InputError

_random = np.random.default_rng()


def set_random_seed(seed):
    """Makes the next random weights, and passes of the next nets, depend on `seed` only. They are not the original Caffe's."""
    global _random
    _random = np.random.default_rng(seed)


def pass_seed():
    """Of what a net draws while it runs, in a Dropout with sample_weights_test."""
    return int(_random.integers(2**63))


def _fan(filler, shape):
    count = math.prod(shape)
    fan_in = count / shape[0] if shape else count
    fan_out = count / shape[1] if len(shape) > 1 else count
    norm = filler.variance_norm
    if norm == filler.AVERAGE:
        return (fan_in + fan_out) / 2
    return fan_out if norm == filler.FAN_OUT else fan_in


def _gaussian(filler, shape):
    values = _random.normal(filler.mean, filler.std, shape)
    if filler.sparse >= 0:
        values *= _random.random(shape) < filler.sparse / shape[0]
    return values


def _unit_ball(shape):
    values = _random.random(shape)
    rows = values.reshape(shape[0], -1)
    rows /= rows.sum(axis=1, keepdims=True)
    return values


def _bilinear(shape):
    if len(shape) != 4 or shape[2] != shape[3]:
        raise InputError(f"the filler 'bilinear' is for square kernels of 4 axes, found {list(shape)}")
    half = math.ceil(shape[3] / 2)
    centre = (shape[3] - 1) / (2 * half)
    weights = 1 - np.abs(np.arange(shape[3]) / half - centre)
    return np.broadcast_to(np.outer(weights, weights), shape)


def fill(filler, shape):
    """Values of a FillerParameter for a blob of `shape`, float32."""
    kinds = {
        'constant': lambda: np.full(shape, filler.value),
        'uniform': lambda: _random.uniform(filler.min, filler.max, shape),
        'gaussian': lambda: _gaussian(filler, shape),
        'positive_unitball': lambda: _unit_ball(shape),
        'xavier': lambda: _random.uniform(-1, 1, shape) * math.sqrt(3 / _fan(filler, shape)),
        'msra': lambda: _random.normal(0, math.sqrt(2 / _fan(filler, shape)), shape),
        'bilinear': lambda: _bilinear(shape),
    }
    if filler.type not in kinds:
        raise InputError(f"unknown filler '{filler.type}', expected one of {', '.join(kinds)}")
    return kinds[filler.type]().astype(np.float32)


# Which message of a layer's parameters has the fillers of its first and second kind of weights, and the constant of
# the first when the file names none.
_FILLERS = {
    **dict.fromkeys(('Convolution', 'DepthwiseConvolution', 'ConvolutionDepthwise', 'Deconvolution'),
                    ('convolution_param', 'weight_filler', 'bias_filler', 0)),
    'InnerProduct': ('inner_product_param', 'weight_filler', 'bias_filler', 0),
    'Embed': ('embed_param', 'weight_filler', 'bias_filler', 0),
    **dict.fromkeys(('LSTM', 'RNN'), ('recurrent_param', 'weight_filler', 'bias_filler', 0)),
    'Scale': ('scale_param', 'filler', 'bias_filler', 1),
    'Bias': ('bias_param', 'filler', 'filler', 0),
    'PReLU': ('prelu_param', 'filler', 'filler', 0.25),
    'Normalize': ('norm_param', 'scale_filler', 'scale_filler', 1),
}


def _initial_of_bn(param, index, shape):
    """SegNet's has scale and shift; PSPNet's slope, bias, mean and variance."""
    if index > 1:
        return np.full(shape, index == 3 and param.frozen, np.float32)
    of_segnet = any(map(param.HasField, ('scale_filler', 'shift_filler', 'bn_mode')))
    names = ('scale_filler', 'shift_filler') if of_segnet else ('slope_filler', 'bias_filler')
    return fill(getattr(param, names[index]), shape)


def initial(message, index, shape):
    """What Caffe gives weight blob `index` of a layer that no weights file has, float32 of `shape`."""
    shape = tuple(shape)
    if message.type == 'BN':
        return _initial_of_bn(message.bn_param, index, shape)
    if message.type not in _FILLERS:  # BatchNorm and Parameter begin with zeros
        return np.zeros(shape, np.float32)
    param, weight, bias, constant = _FILLERS[message.type]
    is_recurrent = param == 'recurrent_param'  # several matrices, and biases between them
    is_bias = len(shape) == 1 if is_recurrent else index > 0
    fillers = getattr(message, param)
    name = bias if is_bias else weight
    if not is_bias and constant and not fillers.HasField(name):
        return np.full(shape, constant, np.float32)
    return fill(getattr(fillers, name), shape)
