"""BatchNorm layers, and the Scale layers after them, folded into the weights of the layer before."""

import tempfile
from pathlib import Path

import numpy as np
from google.protobuf import text_format

from . import compare, engine, examples, files, weights
from .errors import InputError, UnsupportedError
from .graph import is_of_batch, resolve


def convert(options):
    """Folds the network that `options` names and compares both, as the command `fold` says."""
    net = engine.read_net(options.prototxt)
    blobs, types = weights.read_with_types(options.weights)
    try:
        folded, new_blobs, pairs = fold(net, blobs)
    except (ValueError, IndexError) as error:
        raise InputError(f'{options.weights}: its arrays do not fit the net: {error}') from None
    if not pairs:
        raise UnsupportedError(f'{options.prototxt}: no BatchNorm stands alone after a Convolution or InnerProduct')
    for gone, into in pairs:
        print(f"'{gone}' is now in the weights of '{into}'")
    for layer in folded.layer:
        if layer.type == 'BatchNorm':
            print(f"'{layer.name}' stays")
    inputs = examples.arrays(resolve(net), options.input_shape, options.input) if options.check else {}
    with files.appearing(options.out_prototxt, options.out_weights) as [prototxt, model]:
        prototxt.write_text(text_format.MessageToString(folded))
        weights.write(model, new_blobs, types)
        weights.require_same(weights.read(model), new_blobs)
        if options.check:
            with tempfile.TemporaryDirectory() as folder:
                old, new = (weights.for_engine(file, folder) for file in (options.weights, model))
                before = engine.forward(options.prototxt, old, inputs)
                after = engine.forward(prototxt, new, inputs)
                compare.require('folded and not', _by_place(folded, after), _by_place(net, before), options.tolerance)


def _by_place(net, outputs):
    """The outputs in the order of the net: folding may rename one."""
    return {f'{i}': outputs[name] for i, (name, _) in enumerate(resolve(net).outputs)}


def fold(net, blobs):
    """The net and its weights with what can be folded gone, and the pairs (layer that is gone, layer it is in).

    `net` is a NetParameter, `blobs` {layer: arrays}; neither is changed.
    """
    folded, blobs, pairs = type(net)(), dict(blobs), []
    folded.CopyFrom(net)
    graph = resolve(folded)
    graph.require_inputs()
    graph.require_unique_names()
    gone = set()
    for layer in graph.layers:
        for kind in ('BatchNorm', 'Scale'):
            follower = _only_reader(graph, layer, blobs)
            if not follower or follower.type != kind:
                continue
            if kind == 'Scale' and not any(into == layer.name for _, into in pairs):
                continue  # of a layer without BatchNorm
            change = _affine(follower, blobs)
            if change is None:
                break
            _apply(layer, blobs, *change)
            pairs.append((follower.name, layer.name))
            gone.add(follower.name)
            layer.message.top[0] = follower.message.top[0]
            layer.outputs = follower.outputs
            graph.layers.remove(follower)
    result = type(net)(name=net.name)
    for layer in folded.layer:
        if layer.name not in gone:
            result.layer.add().CopyFrom(layer)
    return result, {name: arrays for name, arrays in blobs.items() if name not in gone}, pairs


def _only_reader(graph, layer, blobs):
    """The one layer that reads the output of a layer that can take it in, or None."""
    if layer.type == 'InnerProduct':
        per_channel = layer.message.inner_product_param.axis == 1
    else:
        per_channel = layer.type in ('Convolution', 'ConvolutionDepthwise', 'DepthwiseConvolution') \
            and layer.message.convolution_param.axis == 1
    if not per_channel or any(param.name for param in layer.message.param) or len(layer.outputs) != 1 or layer.name not in blobs:
        return None
    readers = graph.readers(layer.outputs[0])
    return readers[0] if len(readers) == 1 and len(readers[0].inputs) == 1 else None


def _affine(layer, blobs):
    """What a BatchNorm or Scale does, as (factor, shift) per channel in double; None where it does something else."""
    if layer.name not in blobs:
        raise InputError(f"layer '{layer.name}' ({layer.type}) has no weights in the weights file")
    arrays = [array.astype(np.float64).ravel() for array in blobs[layer.name]]
    if layer.type == 'Scale':
        p = layer.message.scale_param
        if p.axis != 1 or p.num_axes != 1:
            return None
        return arrays[0], arrays[1] if p.bias_term else np.zeros_like(arrays[0])
    p = layer.message.batch_norm_param
    if is_of_batch(layer.message):
        return None
    factor = 0 if arrays[2][0] == 0 else 1 / arrays[2][0]
    deviation = np.sqrt(arrays[1] * factor + p.eps)
    return 1 / deviation, -arrays[0] * factor / deviation


def _apply(layer, blobs, factor, shift):
    """Puts y * factor + shift into the weights of the layer that makes y."""
    is_product = layer.type == 'InnerProduct'
    p = layer.message.inner_product_param if is_product else layer.message.convolution_param
    arrays = blobs[layer.name]
    matrix = arrays[0].astype(np.float64)
    if is_product and p.transpose:
        matrix = matrix.reshape(-1, p.num_output) * factor
    else:
        matrix = matrix.reshape(p.num_output, -1) * factor[:, None]
    bias = arrays[1].astype(np.float64).ravel() if p.bias_term else np.zeros(p.num_output)
    p.bias_term = True
    bias = bias * factor + shift
    if not (np.isfinite(matrix).all() and np.isfinite(bias).all()):
        raise InputError(f"layer '{layer.name}': its weights are not finite once the layers after it are folded in")
    blobs[layer.name] = [matrix.astype(np.float32).reshape(arrays[0].shape), bias.astype(np.float32)]
