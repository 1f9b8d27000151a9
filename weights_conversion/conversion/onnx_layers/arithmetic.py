"""Elementwise layers."""

import math

from onnx import TensorProto, helper


def _relu(g, site):
    slope = site.message.relu_param.negative_slope
    return [g.node('LeakyRelu', site.x[0], alpha=slope) if slope else g.node('Relu', site.x[0])]


def _relu6(g, site):
    message = site.message
    slope = (message.relu6_param if message.HasField('relu6_param') else message.relu_param).negative_slope
    y = g.node('Clip', site.x[0], g.constant(0), g.constant(6))
    if slope:
        y = g.node('Add', y, g.affine(g.node('Min', site.x[0], g.constant(0)), slope))
    return [y]


def _prelu(g, site):
    slopes = site.blobs[0].ravel()
    return [g.node('PRelu', site.x[0], g.constant(slopes.reshape((-1,) + (1,) * (len(site.shapes[0]) - 2))))]


def _filled(g, like, value):
    tensor = helper.make_tensor('value', TensorProto.FLOAT, [1], [value])
    return g.node('ConstantOfShape', g.shape(like), value=tensor)


def _power(g, site):
    p = site.message.power_param
    if p.power * p.scale == 0:  # Caffe ignores the input in this case
        return [_filled(g, site.x[0], 1.0 if p.power == 0 else math.pow(p.shift, p.power))]
    y = g.affine(site.x[0], p.scale, p.shift)
    return [y if p.power == 1 else g.node('Pow', y, g.constant(p.power))]


def _exp(g, site):
    p = site.message.exp_param
    inner = p.scale * (1 if p.base == -1 else math.log(p.base))
    outer = math.exp(p.shift) if p.base == -1 else math.pow(p.base, p.shift)
    return [g.affine(g.node('Exp', g.affine(site.x[0], inner)), outer)]


def _log(g, site):
    p = site.message.log_param
    outer = 1 if p.base == -1 else 1 / math.log(p.base)
    return [g.affine(g.node('Log', g.affine(site.x[0], p.scale, p.shift)), outer)]


def _clip(g, site):
    p = site.message.clip_param
    return [g.node('Clip', site.x[0], g.constant(p.min), g.constant(p.max))]


def _dropout(g, site):
    p = site.message.dropout_param
    if p.sample_weights_test:
        site.refuse('random numbers at inference (sample_weights_test) cannot be exported')
    return [site.x[0] if p.scale_train else g.affine(site.x[0], 1 - p.dropout_ratio)]


def _mish(g, site):
    return [g.node('Mul', site.x[0], g.node('Tanh', g.node('Softplus', site.x[0])))]


def _swish(g, site):
    gate = g.node('Sigmoid', g.affine(site.x[0], site.message.swish_param.beta))
    return [g.node('Mul', site.x[0], gate)]


def _threshold(g, site):
    above = g.node('Greater', site.x[0], g.constant(site.message.threshold_param.threshold))
    return [g.to_float(above)]


def _eltwise(g, site):
    p = site.message.eltwise_param
    if p.operation == p.MAX:
        return [g.node('Max', *site.x)]
    if p.operation == p.PROD:
        terms, join = site.x, 'Mul'
    else:
        factors = list(p.coeff) or [1.0] * len(site.x)
        terms, join = [g.affine(x, factor) for x, factor in zip(site.x, factors) if factor != 0], 'Add'
    if not terms:
        return [_filled(g, site.x[0], 0.0)]
    y = terms[0]
    for term in terms[1:]:
        y = g.node(join, y, term)
    return [y]


def _operand(g, site, axis, num_axes):
    """Returns the second operand of Scale and Bias (a weight blob or the second input) and its broadcast shape."""
    first, rank = site.axis(axis), len(site.shapes[0])
    if len(site.x) == 2:
        shape = site.shapes[1]
    else:
        shape = site.shapes[0][first:rank if num_axes == -1 else first + num_axes]
    trailing = rank - first - len(shape) if shape else 0
    over = tuple(shape) + (1,) * trailing
    if len(site.x) == 1:
        return g.constant(site.blobs[0].reshape(over)), over
    if not trailing:
        return site.x[1], over
    return g.node('Unsqueeze', site.x[1], g.integers(*range(len(shape), len(over)))), over


def _scale(g, site):
    p = site.message.scale_param
    factor, over = _operand(g, site, p.axis, p.num_axes)
    y = g.node('Mul', site.x[0], factor)
    if p.bias_term:
        y = g.node('Add', y, g.constant(site.blobs[-1].reshape(over)))
    return [y]


def _bias(g, site):
    p = site.message.bias_param
    return [g.node('Add', site.x[0], _operand(g, site, p.axis, p.num_axes)[0])]


def _axpy(g, site):
    rank = len(site.shapes[1])
    factor = g.reshape(site.x[0], 0, 0, *[1] * (rank - 2))
    return [g.node('Add', g.node('Mul', factor, site.x[1]), site.x[2])]


def _same(g, site):
    if len(site.x) == 2:  # inserted by graph.resolve(): the first input in the shape of the second
        return [g.node('Reshape', site.x[0], g.shape(site.x[1]))]
    return [site.x[0]] * len(site.layer.outputs)


def _unary(op):
    return lambda g, site: [g.node(op, site.x[0])]


EMIT = {
    'AbsVal': _unary('Abs'), 'Axpy': _axpy, 'Bias': _bias, 'BNLL': _unary('Softplus'), 'Clip': _clip, 'Dropout': _dropout,
    'ELU': lambda g, site: [g.node('Elu', site.x[0], alpha=site.message.elu_param.alpha)],
    'Eltwise': _eltwise, 'Exp': _exp, 'HardSwish': _unary('HardSwish'), 'Log': _log, 'Mish': _mish,
    'Mul': lambda g, site: [g.node('Mul', *site.x)], 'Power': _power, 'PReLU': _prelu, 'ReLU': _relu, 'ReLU6': _relu6,
    'Scale': _scale, 'Sigmoid': _unary('Sigmoid'), 'Silence': lambda g, site: [], 'Split': _same, 'Swish': _swish,
    'TanH': _unary('Tanh'), 'Threshold': _threshold,
}
