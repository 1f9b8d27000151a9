"""Folding of BatchNorm layers, and of the Scale layers after them, into the weights of the previous layer."""

import tempfile

import numpy as np
from google.protobuf import text_format

from . import compare, engine, files, weights
from revisit.errors import InputError, UnsupportedError
from .graph import is_of_batch, resolve, statistics


def convert(options):
    """Runs the command `fold`: folds the network and compares both."""
    net = engine.read_net(options.prototxt)
    blobs, types = weights.read_with_types(options.weights)
    try:
        folded, new_blobs, pairs = fold(net, blobs)
    except (ValueError, IndexError) as error:
        raise InputError(f'{options.weights}: arrays do not match the net: {error}') from None
    if not pairs:
        raise UnsupportedError(f'{options.prototxt}: no BatchNorm that is the only reader of a Convolution or InnerProduct')
    for gone, into in pairs:
        print(f"folded '{gone}' into '{into}'")
    for layer in folded.layer:
        if layer.type == 'BatchNorm':
            print(f"kept '{layer.name}'")
    inputs = compare.arrays(resolve(net), options.input) if options.check else {}
    with files.appearing(options.out_prototxt, options.out_weights) as [prototxt, model]:
        prototxt.write_text(text_format.MessageToString(folded))
        weights.write(model, new_blobs, types)
        weights.require_same(weights.read(model), new_blobs)
        if options.check:
            with tempfile.TemporaryDirectory() as folder:
                old, new = (weights.for_engine(file, folder) for file in (options.weights, model))
                before = engine.forward(options.prototxt, old, inputs)
                after = engine.forward(prototxt, new, inputs)
                compare.require('folded and original', _by_place(folded, after), _by_place(net, before))


def _by_place(net, outputs):
    """Returns the outputs by their index, because folding may rename them."""
    return {f'{i}': outputs[name] for i, (name, _) in enumerate(resolve(net).outputs)}


def fold(net, blobs):
    """Returns the folded net and weights, and the pairs (folded layer, layer with its weights).

    net: a NetParameter. blobs: {layer: arrays}. Neither is modified.
    """
    folded, blobs, pairs = type(net)(), dict(blobs), []
    folded.CopyFrom(net)
    graph = resolve(folded)
    graph.require_unique_names()
    gone = set()
    for layer in graph.layers:
        for kind in ('BatchNorm', 'Scale'):
            follower = _only_reader(graph, layer, blobs)
            if not follower or follower.type != kind:
                continue
            if kind == 'Scale' and not any(into == layer.name for _, into in pairs):
                continue  # the layer has no BatchNorm
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
    """Returns a BatchNorm or Scale as (factor, shift) per channel in double; None if it is not a per-channel affine function."""
    if layer.name not in blobs:
        raise InputError(f"layer '{layer.name}' ({layer.type}): no weights in the weights file")
    arrays = [array.astype(np.float64).ravel() for array in blobs[layer.name]]
    if layer.type == 'Scale':
        p = layer.message.scale_param
        if p.axis != 1 or p.num_axes != 1:
            return None
        return arrays[0], arrays[1] if p.bias_term else np.zeros_like(arrays[0])
    p = layer.message.batch_norm_param
    if is_of_batch(layer.message):
        return None
    mean, variance, scale, bias, eps = statistics(p, arrays)
    factor = scale / np.sqrt(variance + eps)
    return factor, bias - mean * factor


def _apply(layer, blobs, factor, shift):
    """Folds y * factor + shift into the weights of the layer with output y."""
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
        raise InputError(f"layer '{layer.name}': folded weights are not finite")
    blobs[layer.name] = [matrix.astype(np.float32).reshape(arrays[0].shape), bias.astype(np.float32)]
