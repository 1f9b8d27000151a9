"""Conversion of networks from other frameworks to Caffe, with a comparison of outputs."""

from . import compare, engine, examples, files, means, weights
from .errors import CheckFailed, InputError, UsageError


def _shape(options, default):
    if not options.input_shape:
        return default
    shape = examples.shape_of(options.input_shape)
    if len(shape) != 4:
        raise UsageError(f'--input-shape: expected NxCxHxW, found {options.input_shape}')
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


def write(options, net, reference, end=None):
    """Writes a NetWriter to the files of `options`, and compares it with the original.

    reference: function from an input [n][c][h][w] of the original to its output, or None.
    end: layer whose output is compared; None: the last.
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
        x = examples.random(shape) / 10  # scaled pixels
        expected = reference(x) if reference else None
        found = engine.forward(prototxt, weights.for_engine(model, prototxt.parent), {'data': x[:, ::-1] if options.bgr else x},
                               end)
        if len(found) != 1:
            raise CheckFailed(f'check failed: expected one output, found {len(found)}')
        if expected is None:
            print('not compared: the network runs, but PyTorch and torchvision are not installed')
            return
        [output] = found.values()
        compare.require('the original and the engine', {'output': output.reshape(-1)}, {'output': expected.reshape(-1)},
                        options.tolerance)


def matconvnet(options):
    """The command `matconvnet`."""
    from . import matconvnet as format
    from . import matconvnet_reference
    layers, normalization = format.load(options.mat)
    shape = _shape(options, None) or format.input_shape(layers, normalization)
    mean = format.mean_image(normalization)
    if options.mean and mean is None:
        raise InputError(f'{options.mat}: no mean image')
    net = format.convert(layers, shape, options.mat)
    end = None
    if len(layers) > 1 and layers[-1].type == 'softmax':  # a softmax would hide differences
        layers, end = layers[:-1], net.net.layer[-2].name
    write(options, net, lambda x: matconvnet_reference.forward(layers, x), end)
    if options.mean:
        mean = mean[::-1] if options.bgr else mean
        with files.appearing(options.mean) as [part]:
            means.write(part, mean)


def torch(options):
    """The command `torch`."""
    from . import torch_state, torchvision_nets
    if options.architecture not in torchvision_nets.NAMES:
        raise UsageError(f"unknown network '{options.architecture}'; expected one of {', '.join(torchvision_nets.NAMES)}")
    if options.transform_input and options.architecture != 'googlenet':
        raise UsageError('--transform-input: only supported for googlenet')
    state = torch_state.read(options.state)
    net = torchvision_nets.convert(options.architecture, state, _shape(options, [1, 3, 224, 224]), options.transform_input)
    write(options, net, _torchvision(options, state))


def _torchvision(options, state):
    """Returns the original as a function of x, or None without PyTorch and torchvision."""
    try:
        import torch as pytorch
        import torchvision
    except ImportError:
        return None
    extra = {}
    if options.architecture == 'googlenet':
        extra = dict(aux_logits=any(key.startswith('aux1.') for key in state), init_weights=False,
                     transform_input=options.transform_input)
    model = getattr(torchvision.models, options.architecture)(weights=None, **extra)
    try:
        model.load_state_dict({key: pytorch.from_numpy(array.copy()) for key, array in state.items()})
    except RuntimeError as error:
        raise InputError(f'{options.state}: torchvision rejects the state dict: {" ".join(str(error).split())[:200]}') from None
    model.eval()

    def forward(x):
        with pytorch.no_grad():
            return model(pytorch.from_numpy(x)).numpy()
    return forward
