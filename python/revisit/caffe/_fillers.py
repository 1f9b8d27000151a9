"""Initial values of weights that are in no file."""

import math

import numpy as np

from ..errors import InputError

_random = np.random.default_rng()


def set_random_seed(seed):
    """Seeds random weights and passes of nets created later. Values differ from the original Caffe's."""
    global _random
    _random = np.random.default_rng(seed)


def pass_seed():
    """Returns a seed for Dropout layers that are active at inference (sample_weights_test)."""
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
        raise InputError(f"filler 'bilinear': expected a square kernel of 4 axes, found {list(shape)}")
    half = math.ceil(shape[3] / 2)
    center = (shape[3] - 1) / (2 * half)
    weights = 1 - np.abs(np.arange(shape[3]) / half - center)
    return np.broadcast_to(np.outer(weights, weights), shape)


def fill(filler, shape):
    """Returns float32. Raises InputError for an unknown type."""
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
        raise InputError(f"filler: expected one of {', '.join(kinds)}, found '{filler.type}'")
    return kinds[filler.type]().astype(np.float32)


# Layer type -> message with the fillers, filler of weights, filler of biases, default constant of weights.
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
    """SegNet's BN has scale and shift; PSPNet's has slope, bias, mean and variance."""
    if index > 1:
        return np.full(shape, index == 3 and param.frozen, np.float32)
    of_segnet = any(map(param.HasField, ('scale_filler', 'shift_filler', 'bn_mode')))
    names = ('scale_filler', 'shift_filler') if of_segnet else ('slope_filler', 'bias_filler')
    return fill(getattr(param, names[index]), shape)


def initial(message, index, shape):
    """Returns Caffe's initial values of weight blob `index` of a layer, float32 of `shape`."""
    shape = tuple(shape)
    if message.type == 'BN':
        return _initial_of_bn(message.bn_param, index, shape)
    if message.type not in _FILLERS:  # BatchNorm and Parameter start with zeros
        return np.zeros(shape, np.float32)
    param, weight, bias, constant = _FILLERS[message.type]
    is_recurrent = param == 'recurrent_param'  # has several matrices, with biases between them
    is_bias = len(shape) == 1 if is_recurrent else index > 0
    fillers = getattr(message, param)
    name = bias if is_bias else weight
    if not is_bias and constant and not fillers.HasField(name):
        return np.full(shape, constant, np.float32)
    return fill(getattr(fillers, name), shape)
