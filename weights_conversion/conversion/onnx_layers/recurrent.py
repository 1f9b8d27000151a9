"""LSTM, RNN, and the Lstm of CTPN.

Caffe's continuation indicators reset the state within a sequence. ONNX's operators do not support this, so a Scan runs the
cell step by step. Without expose_hidden, Caffe keeps the state between passes; an ONNX model starts every pass from zero, like
Caffe's first pass.
"""

import numpy as np
from onnx import TensorProto, helper, numpy_helper

from ..onnx_builder import Builder


def _recurrent(g, site, cell, n_states):
    p = site.message.recurrent_param
    n, weights = p.num_output, list(site.blobs)
    exposed = n_states if p.expose_hidden else 0
    has_static = len(site.x) > 2 + exposed
    gates = n if n_states == 1 else 4 * n
    x = g.reshape(site.x[0], 0, 0, -1)
    terms = g.node('MatMul', x, g.constant(weights[0].reshape(gates, -1).T))
    terms = g.node('Add', terms, g.constant(weights[1].ravel()))
    if has_static:
        fixed = g.reshape(site.x[2], 0, -1)
        terms = g.node('Add', terms, g.node('MatMul', fixed, g.constant(weights[2].reshape(gates, -1).T)))
        del weights[2]
    continues = g.reshape(site.x[1], 0, 0, 1)
    if exposed:
        states = [g.reshape(state, g.shape(site.x[0], 1, 2), n) for state in site.x[-exposed:]]
    else:
        size = g.node('Concat', g.shape(site.x[0], 1, 2), g.integers(n), axis=0)
        states = [g.node('ConstantOfShape', size)] * n_states
    hidden = [array.reshape(-1, n).T for array in weights[2:4]]
    results = _scan(g, site, cell, states, terms, continues, hidden + [array.ravel() for array in weights[4:]])
    last = [g.node('Unsqueeze', state, g.integers(0)) for state in results[:exposed]]
    return [results[-1], *last]


def _scan(g, site, cell, states, terms, continues, weights):
    body = _body(cell, len(states), weights, site.layer.name)
    return g.node('Scan', *states, terms, continues, body=body, num_scan_inputs=2, n_outputs=len(states) + 1)


def _rows_lstm(g, site):
    p = site.message.lstm_param
    n, rows = p.num_output, p.HasField('batch_size') or len(site.shapes[0]) == 2
    from_x, from_h = site.blobs[0].reshape(4 * n, -1), site.blobs[1].reshape(4 * n, n)
    layout = (-1, p.batch_size) if rows else (0, 0)
    x = g.reshape(site.x[0], *layout, from_x.shape[1])
    if len(site.x) == 1:
        in_order = np.arange(4 * n).reshape(4, n)[[0, 2, 1, 3]].ravel()  # gates from Caffe's i, f, o, g to ONNX's i, o, f, g
        bias = np.concatenate([site.blobs[2].ravel()[in_order], np.zeros(4 * n)])
        weights = [g.constant(array[None]) for array in (from_x[in_order], from_h[in_order], bias)]
        y = g.node('Squeeze', g.node('LSTM', x, *weights, hidden_size=n), g.integers(1))
    else:
        terms = g.node('Add', g.node('MatMul', x, g.constant(from_x.T)), g.constant(site.blobs[2].ravel()))
        size = g.node('Concat', g.shape(x, 1, 2), g.integers(n), axis=0)
        state = g.node('ConstantOfShape', size)
        steps, streams = [g.node('Range', g.constant(0, np.int64), g.node('Squeeze', g.shape(x, axis, axis + 1)), g.constant(1, np.int64))
                          for axis in (0, 1)]
        places = g.node('Add', g.node('Unsqueeze', steps, g.integers(1, 2)), g.node('Unsqueeze', streams, g.integers(1)))
        begins = g.node('Equal', g.node('Gather', g.reshape(site.x[1], -1), places), g.constant(0))
        y = _scan(g, site, _lstm_cell, [state] * 2, terms, g.to_float(g.node('Not', begins)), [from_h.T])[-1]
    return [g.reshape(y, -1, n) if rows else y]


def _body(cell, n_states, weights, prefix):
    """Returns the graph of one step: states, input part of the gates, continues -> states, output."""
    b = Builder(f'{prefix}/step')
    states = [f'{prefix}/state{i}' for i in range(n_states)]
    terms, continues = f'{prefix}/terms', f'{prefix}/continues'
    after, y = cell(b, states, terms, continues, [b.constant(w) for w in weights])
    outputs = [b.node('Identity', name) for name in (*after, y)]  # outputs need distinct names
    def info(name):
        return helper.make_tensor_value_info(name, TensorProto.FLOAT, [None, None])
    return helper.make_graph(b.nodes, 'step', [info(name) for name in (*states, terms, continues)],
                             [info(name) for name in outputs],
                             [numpy_helper.from_array(array, name) for name, array in b.constants.items()])


def _lstm_cell(b, states, terms, continues, weights):
    hidden, memory = states
    gates = b.node('Add', terms, b.node('MatMul', b.node('Mul', hidden, continues), weights[0]))
    i, f, o, g = b.node('Split', gates, axis=1, n_outputs=4)
    kept = b.node('Mul', b.node('Mul', b.node('Sigmoid', f), continues), memory)
    memory = b.node('Add', kept, b.node('Mul', b.node('Sigmoid', i), b.node('Tanh', g)))
    hidden = b.node('Mul', b.node('Sigmoid', o), b.node('Tanh', memory))
    return [hidden, memory], hidden


def _rnn_cell(b, states, terms, continues, weights):
    from_hidden, to_output, bias = weights
    hidden = b.node('Tanh', b.node('Add', terms, b.node('MatMul', b.node('Mul', states[0], continues), from_hidden)))
    return [hidden], b.node('Tanh', b.node('Add', b.node('MatMul', hidden, to_output), bias))


EMIT = {'LSTM': lambda g, site: _recurrent(g, site, _lstm_cell, 2), 'Lstm': _rows_lstm,
        'RNN': lambda g, site: _recurrent(g, site, _rnn_cell, 1)}
