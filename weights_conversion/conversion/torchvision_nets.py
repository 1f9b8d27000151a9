"""Conversion of torchvision's networks to Caffe networks.

Each function takes a Writer and the input blob. Sizes, channels and groups come from the arrays; strides and pads, which are
not in a state dict, are defined here. torchvision rounds pooling sizes down without ceil_mode, Caffe rounds up without
round_mode FLOOR. round_mode is set such that outputs are equal for every input size.
"""

import re

import numpy as np

from revisit.errors import Error, InputError

from .files import existing, read_npz
from .to_caffe import NetWriter

IMAGENET_MEAN, IMAGENET_DEVIATION = (0.485, 0.456, 0.406), (0.229, 0.224, 0.225)


class Writer(NetWriter):
    """Adds layers with weights of a state dict. Layers are named after the keys."""

    def __init__(self, name, state, input_shape):
        super().__init__(name, input_shape)
        self.state, self.used = state, set()

    def take(self, key):
        if key not in self.state:
            raise InputError(f"state dict: expected the key '{key}' of {self.net.name}, found none")
        self.used.add(key)
        return np.asarray(self.state[key], np.float32)

    def conv(self, key, x, stride=1, pad=0, norm=None, eps=1e-5, relu=True):
        weights = self.take(f'{key}.weight')
        if weights.ndim != 4 or weights.size == 0 or self.channels(x) % weights.shape[1]:
            raise InputError(f"'{key}.weight': shape {list(weights.shape)} does not match an input of {self.channels(x)} channels")
        bias = self.take(f'{key}.bias') if f'{key}.bias' in self.state else None
        x = self.convolution(key, x, weights, bias, stride, pad)
        if norm:
            arrays = [self.take(f'{norm}.{part}') for part in ('running_mean', 'running_var', 'weight', 'bias')]
            self.used.add(f'{norm}.num_batches_tracked')
            x = self.add(norm, 'BatchNorm', x, [*arrays[:2], np.ones(1)], in_place=True, batch_norm_param=dict(eps=eps))
            x = self.add(f'{norm}.scale', 'Scale', x, arrays[2:], in_place=True, scale_param=dict(bias_term=True))
        return self.relu(f'{key}.relu', x) if relu else x

    def relu(self, name, x):
        return self.add(name, 'ReLU', x, in_place=True)

    def relu6(self, name, x):
        return self.add(name, 'Clip', x, in_place=True, clip_param=dict(min=0, max=6))

    def linear(self, key, x):
        weights = self.take(f'{key}.weight')
        return self.add(key, 'InnerProduct', x, [weights, self.take(f'{key}.bias')],
                        inner_product_param=dict(num_output=weights.shape[0]))

    def max_pool(self, name, x, kernel, stride, pad=0, ceil=False):
        p = dict(pool='MAX', kernel_size=kernel, stride=stride, pad=pad)
        return self.add(name, 'Pooling', x, pooling_param=p if ceil else p | dict(round_mode='FLOOR'))

    def global_average(self, x):
        return self.add('avgpool', 'Pooling', x, pooling_param=dict(pool='AVE', global_pooling=True))

    def blocks(self, prefix):
        """Returns the numbers of the modules 'PREFIX.0', 'PREFIX.1', ..."""
        return sorted({int(found[1]) for key in self.state if (found := re.match(re.escape(prefix) + r'\.(\d+)\.', key))})


def alexnet(net, x):
    x = net.max_pool('pool1', net.conv('features.0', x, 4, 2), 3, 2)
    x = net.max_pool('pool2', net.conv('features.3', x, 1, 2), 3, 2)
    for key in ('features.6', 'features.8', 'features.10'):
        x = net.conv(key, x, 1, 1)
    x = net.max_pool('pool5', x, 3, 2)
    return _classifier(net, x, ('classifier.1', 'classifier.4', 'classifier.6'))


def _classifier(net, x, keys):
    for key in keys:
        x = net.linear(key, x)
        if key != keys[-1]:
            x = net.relu(f'{key}.relu', x)
    return x


def vgg(net, x):
    """3 x 3 convolutions. A gap in the numbers of modules is a pooling layer."""
    with_norm = 'features.1.running_mean' in net.state
    modules = [n for n in net.blocks('features') if np.ndim(net.state.get(f'features.{n}.weight')) == 4]
    step, n_pools = (3 if with_norm else 2), 0
    for n, following in zip(modules, [*modules[1:], None]):
        x = net.conv(f'features.{n}', x, 1, 1, norm=f'features.{n + 1}' if with_norm else None)
        if following is None or following > n + step:
            n_pools += 1
            x = net.max_pool(f'pool{n_pools}', x, 2, 2)
    return _classifier(net, x, ('classifier.0', 'classifier.3', 'classifier.6'))


def squeezenet(net, x):
    """Version 1.0 starts with a 7 x 7 convolution, 1.1 with 3 x 3 and earlier pooling."""
    is_first = np.shape(net.take('features.0.weight'))[-1] == 7
    pools = (2, 6, 11) if is_first else (2, 5, 8)
    x = net.conv('features.0', x, 2)
    for n in range(2, 13):
        if n in pools:
            x = net.max_pool(f'features.{n}', x, 3, 2, ceil=True)
            continue
        key = f'features.{n}'
        squeezed = net.conv(f'{key}.squeeze', x)
        expanded = [net.conv(f'{key}.expand1x1', squeezed), net.conv(f'{key}.expand3x3', squeezed, 1, 1)]
        x = net.add(key, 'Concat', expanded)
    return net.global_average(net.conv('classifier.1', x))


def resnet(net, x):
    """ResNet, ResNeXt and wide ResNet: groups and widths come from the arrays."""
    x = net.max_pool('maxpool', net.conv('conv1', x, 2, 3, norm='bn1'), 3, 2, 1)
    for stage in range(1, 5):
        for block in net.blocks(f'layer{stage}'):
            key, stride = f'layer{stage}.{block}', 2 if stage > 1 and block == 0 else 1
            skipped = x
            if f'{key}.downsample.0.weight' in net.state:
                skipped = net.conv(f'{key}.downsample.0', x, stride, norm=f'{key}.downsample.1', relu=False)
            if f'{key}.conv3.weight' in net.state:
                y = net.conv(f'{key}.conv1', x, norm=f'{key}.bn1')
                y = net.conv(f'{key}.conv2', y, stride, 1, norm=f'{key}.bn2')
                y = net.conv(f'{key}.conv3', y, norm=f'{key}.bn3', relu=False)
            else:
                y = net.conv(f'{key}.conv1', x, stride, 1, norm=f'{key}.bn1')
                y = net.conv(f'{key}.conv2', y, 1, 1, norm=f'{key}.bn2', relu=False)
            x = net.relu(f'{key}.relu', net.add(key, 'Eltwise', [y, skipped]))
    return net.linear('fc', net.global_average(x))


def mobilenet_v2(net, x):
    def conv(key, x, stride=1, pad=0):
        return net.relu6(f'{key}.relu6', net.conv(f'{key}.0', x, stride, pad, norm=f'{key}.1', relu=False))
    strides = {n: 2 for n in (2, 4, 7, 14)}  # first blocks of stages that halve the size
    x = conv('features.0', x, 2, 1)
    last = max(net.blocks('features'), default=0)
    for n in range(1, last):
        key, y = f'features.{n}.conv', x
        parts = net.blocks(key)
        expands = len(parts) == 4
        if expands:
            y = conv(f'{key}.0', y)
        middle = int(expands)
        y = conv(f'{key}.{middle}', y, strides.get(n, 1), 1)
        y = net.conv(f'{key}.{middle + 1}', y, norm=f'{key}.{middle + 2}', relu=False)
        skips = n not in strides and net.channels(x) == net.channels(y)
        x = net.add(f'features.{n}', 'Eltwise', [x, y]) if skips else y
    return net.linear('classifier.1', net.global_average(conv(f'features.{last}', x)))


def googlenet(net, x):
    """GoogLeNet without the auxiliary classifiers, which are for training."""
    net.used |= {key for key in net.state if key.startswith(('aux1.', 'aux2.'))}

    def conv(key, x, stride=1, pad=0):
        return net.conv(f'{key}.conv', x, stride, pad, norm=f'{key}.bn', eps=1e-3)
    x = net.max_pool('maxpool1', conv('conv1', x, 2, 3), 3, 2, ceil=True)
    x = net.max_pool('maxpool2', conv('conv3', conv('conv2', x), 1, 1), 3, 2, ceil=True)
    for name in ('3a', '3b', 'pool3', '4a', '4b', '4c', '4d', '4e', 'pool4', '5a', '5b'):
        if name.startswith('pool'):
            x = net.max_pool('max' + name, x, 3 if name == 'pool3' else 2, 2, ceil=True)
            continue
        key = f'inception{name}'
        pooled = net.max_pool(f'{key}.pool', x, 3, 1, 1)
        x = net.add(key, 'Concat', [
            conv(f'{key}.branch1', x), conv(f'{key}.branch2.1', conv(f'{key}.branch2.0', x), 1, 1),
            conv(f'{key}.branch3.1', conv(f'{key}.branch3.0', x), 1, 1), conv(f'{key}.branch4.1', pooled)])
    return net.linear('fc', net.global_average(x))


FAMILIES = {'alexnet': alexnet, 'vgg': vgg, 'squeezenet': squeezenet, 'resnet': resnet, 'resnext': resnet,
            'wide_resnet': resnet, 'mobilenet_v2': mobilenet_v2, 'googlenet': googlenet}
NAMES = ['alexnet', *(f'vgg{n}{bn}' for n in (11, 13, 16, 19) for bn in ('', '_bn')), 'squeezenet1_0', 'squeezenet1_1',
         *(f'resnet{n}' for n in (18, 34, 50, 101, 152)), 'resnext50_32x4d', 'resnext101_32x8d', 'resnext101_64x4d',
         'wide_resnet50_2', 'wide_resnet101_2', 'mobilenet_v2', 'googlenet', 'googlenet_transform_input']


def convert(name, state, input_shape):
    """Converts a state dict {key: array} of a network in NAMES to a NetWriter. Raises InputError if keys do not match."""
    net, x = Writer(name, state, input_shape), 'data'
    if name.endswith('transform_input'):  # torchvision's GoogLeNet expects pixels in -1 .. 1 and converts normalized ones
        mean, deviation = np.array(IMAGENET_MEAN), np.array(IMAGENET_DEVIATION)
        x = net.add('transform_input', 'Scale', x, [deviation / 0.5, (mean - 0.5) / 0.5], scale_param=dict(bias_term=True))
    family = max((family for family in FAMILIES if name.startswith(family)), key=len)
    FAMILIES[family](net, x)
    unused = sorted(set(state) - net.used)
    if unused:
        raise InputError(f"state dict: expected the keys of {name}, found '{unused[0]}'" +
                         (f' and {len(unused) - 1} others' if len(unused) > 1 else ''))
    _require_depth(name, net)
    return net


def _require_depth(name, net):
    """Checks the number in the name, which counts convolutions and inner products except those of shortcuts."""
    digits = re.fullmatch(r'(?:vgg|wide_resnet|resnext|resnet)(\d+).*', name)
    n_layers = sum(layer.type in ('Convolution', 'InnerProduct') and 'downsample' not in layer.name for layer in net.net.layer)
    if digits and n_layers != int(digits[1]):
        raise InputError(f'state dict: expected {digits[1]} layers with weights ({name}), found {n_layers}')


def read_state(path):
    """Reads {key: array} from a .safetensors, .npz or PyTorch file (.pth, .pt; needs torch)."""
    path = existing(path)
    ending = path.suffix.lower()
    readers = {'.safetensors': _safetensors, '.npz': lambda file: dict(read_npz(file))}
    state = readers.get(ending, _torch)(path)
    if not state:
        raise InputError(f'{path}: expected arrays, found none')
    return state


def _safetensors(path):
    from safetensors import SafetensorError
    from safetensors.numpy import load_file
    try:
        return load_file(str(path))
    except (SafetensorError, OSError, ValueError, KeyError, TypeError) as error:
        raise InputError(f'{path}: not a readable safetensors file: {error}') from None


def _torch(path):
    try:
        import torch
    except ImportError:
        raise Error(f'{path}: reading it needs PyTorch (pip install torch); .safetensors and .npz do not') from None
    major, minor = torch.__version__.split('.')[:2]
    if (int(major), int(minor)) < (2, 6):  # CVE-2025-32434: weights_only runs code
        raise Error(f'{path}: expected PyTorch 2.6 or later, because older versions may run code from the file, found '
                    f'{torch.__version__} (pip install -U torch); .safetensors and .npz do not need PyTorch')
    try:
        state = torch.load(path, map_location='cpu', weights_only=True)  # rejects everything but numbers
    except Exception as error:  # pickle, zip and torch raise many types
        raise InputError(f'{path}: expected a state dict with numbers only: {" ".join(str(error).split())[:200]}') from None
    if isinstance(state, dict) and isinstance(state.get('state_dict'), dict):
        state = state['state_dict']  # a training checkpoint
    if not isinstance(state, dict) or not all(isinstance(value, torch.Tensor) for value in state.values()):
        raise InputError(f'{path}: expected a state dict (names and tensors), found {type(state).__name__}')
    return {key.removeprefix('module.'): value.detach().to('cpu').float().numpy()
            if value.is_floating_point() else value.cpu().numpy() for key, value in state.items()}
