"""Conversion of networks from other frameworks to Caffe, with a comparison of outputs."""

import numpy as np
from google.protobuf import text_format

from revisit.caffe.proto import caffe_pb2
from revisit.errors import InputError, UsageError

from . import compare, engine, files, weights


class NetWriter:
    """Adds layers after any blob. Methods return the blob that the layer writes."""

    def __init__(self, name, input_shape, blob='data'):
        self.net, self.blobs = caffe_pb2.NetParameter(name=name), {}
        layer = self.net.layer.add(name=blob, type='Input', top=[blob])
        layer.input_param.shape.add(dim=input_shape)

    def add(self, name, kind, bottoms, arrays=(), in_place=False, **parameters):
        """Adds a layer. arrays: weights. parameters: e.g. convolution_param=dict(...)."""
        bottoms = [bottoms] if isinstance(bottoms, str) else list(bottoms)
        top = bottoms[0] if in_place else name
        self.net.layer.add(name=name, type=kind, bottom=bottoms, top=[top], **parameters)
        if arrays:
            self.blobs[name] = [np.ascontiguousarray(array, np.float32) for array in arrays]
        return top

    def convolution(self, name, bottom, weights, bias=None, stride=1, pad=0, dilation=1):
        """Adds a convolution. weights: [outputs][inputs / groups][h][w]; groups follow from the channels of `bottom`."""
        outputs, per_group, h, w = weights.shape
        channels = self.channels(bottom)
        if channels % per_group:
            raise InputError(f"layer '{name}': weights for {per_group} channels do not match an input of {channels} channels")
        p = dict(num_output=outputs, bias_term=bias is not None, group=channels // per_group)
        p.update(dict(kernel_size=[h]) if h == w else dict(kernel_h=h, kernel_w=w))
        for field, value in (('stride', stride), ('pad', pad)):
            values = (value, value) if isinstance(value, int) else tuple(value)
            if values[0] == values[1]:
                p[field] = [values[0]]
            else:
                p[f'{field}_h'], p[f'{field}_w'] = values
        if dilation != 1:
            p['dilation'] = [dilation]
        return self.add(name, 'Convolution', bottom, [weights] if bias is None else [weights, bias], convolution_param=p)

    def channels(self, blob):
        """Returns the channels of a blob, inferred from the layers that write it."""
        for layer in reversed(self.net.layer):
            if blob not in layer.top:
                continue
            if layer.type == 'Input':
                return layer.input_param.shape[0].dim[1]
            if layer.type == 'Convolution':
                return layer.convolution_param.num_output
            if layer.type == 'Concat':
                return sum(map(self.channels, layer.bottom))
            if layer.bottom[0] != blob:
                blob = layer.bottom[0]
        raise AssertionError(f'no layer writes {blob}')

    def text(self):
        return text_format.MessageToString(self.net)

    def types(self):
        return {layer.name: layer.type for layer in self.net.layer}


def _shape(options, default):
    if not options.input:
        return default
    shape = compare.shape_of(options.input[-1])
    if len(shape) != 4:
        raise UsageError(f'--input: expected NxCxHxW, found {options.input[-1]}')
    return list(shape)


def _swap_colors(net):
    bottom = 'data'
    for layer in net.net.layer:
        if bottom not in layer.bottom or layer.name not in net.blobs:
            continue
        if net.channels('data') != 3:
            raise UsageError(f"--bgr: expected a network with 3 input channels, found {net.channels('data')}")
        arrays = net.blobs[layer.name]
        if layer.type == 'Convolution':
            if layer.convolution_param.group != 1:
                break
            arrays[0] = arrays[0][:, ::-1].copy()
            return
        net.blobs[layer.name] = [array[::-1].copy() for array in arrays]  # a Scale per color
        bottom = layer.top[0]
    raise UsageError('--bgr: expected a network that starts with a convolution of three colors')


def write(options, net, reference, end=''):
    """Writes a NetWriter to the files of `options`, and compares it with the original.

    reference: function from an input [n][c][h][w] of the original to its output, or None.
    end: layer whose output is compared; '': the last.
    """
    shape = tuple(net.net.layer[0].input_param.shape[0].dim)
    if options.bgr:
        _swap_colors(net)
    with files.appearing(options.out_prototxt, options.out_weights) as [prototxt, model]:
        prototxt.write_text(net.text())
        weights.write(model, net.blobs, net.types())
        weights.require_same(weights.read(model), net.blobs)
        if not options.check:
            return
        x = compare.random(shape) / 10  # scaled pixels
        expected = reference(x) if reference else None
        found = engine.forward(prototxt, weights.for_engine(model, prototxt.parent), {'data': x[:, ::-1] if options.bgr else x},
                               end)
        if len(found) != 1:
            raise compare.CheckFailed(f'check failed: expected one output, found {len(found)}')
        if expected is None:
            print('not compared: the network runs, but PyTorch and torchvision are not installed')
            return
        [output] = found.values()
        compare.require('the original and the engine', {'output': output.reshape(-1)}, {'output': expected.reshape(-1)})


def matconvnet(options):
    """The command `matconvnet`."""
    from . import matconvnet as format
    layers, normalization = format.load(options.mat)
    shape = _shape(options, None) or format.input_shape(layers, normalization)
    mean = format.mean_image(normalization)
    if options.mean and mean is None:
        raise InputError(f'{options.mat}: no mean image')
    net = format.convert(layers, shape, options.mat)
    end = ''
    if len(layers) > 1 and layers[-1].type == 'softmax':  # a softmax would hide differences
        layers, end = layers[:-1], net.net.layer[-2].name
    write(options, net, lambda x: format.forward(layers, x), end)
    if options.mean:
        mean = mean[::-1] if options.bgr else mean
        with files.appearing(options.mean) as [part]:
            files.write_mean(part, mean)


def torch(options):
    """The command `torch`."""
    from . import torchvision_nets
    if options.architecture not in torchvision_nets.NAMES:
        raise UsageError(f"unknown network '{options.architecture}'; expected one of {', '.join(torchvision_nets.NAMES)}")
    state = torchvision_nets.read_state(options.state)
    net = torchvision_nets.convert(options.architecture, state, _shape(options, [1, 3, 224, 224]))
    write(options, net, _torchvision(options, state))


def _torchvision(options, state):
    """Returns the original as a function of x, or None without PyTorch and torchvision."""
    try:
        import torch as pytorch
        import torchvision
    except ImportError:
        return None
    name, extra = options.architecture, {}
    if name.startswith('googlenet'):
        extra = dict(aux_logits=any(key.startswith('aux1.') for key in state), init_weights=False,
                     transform_input=name.endswith('transform_input'))
        name = 'googlenet'
    model = getattr(torchvision.models, name)(weights=None, **extra)
    try:
        model.load_state_dict({key: pytorch.from_numpy(array.copy()) for key, array in state.items()})
    except RuntimeError as error:
        raise InputError(f'{options.state}: torchvision rejects the state dict: {" ".join(str(error).split())[:200]}') from None
    model.eval()

    def forward(x):
        with pytorch.no_grad():
            return model(pytorch.from_numpy(x)).numpy()
    return forward
