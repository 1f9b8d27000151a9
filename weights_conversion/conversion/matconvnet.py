"""Conversion of MatConvNet networks (SimpleNN, .mat files) to Caffe networks.

Format: http://www.vlfeat.org/matconvnet/mfiles/simplenn/vl_simplenn/. Filters are [h][w][inputs / groups][outputs], pads
[top bottom left right], strides [down across].
"""

import struct
import zlib
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import current_process, get_context
from types import SimpleNamespace

import numpy as np
import scipy.io

from revisit.errors import Error, InputError, UnsupportedError
from .files import check_unpacked, existing
from .to_caffe import NetWriter


MAX_PIXELS = 1000  # limit of pads, strides and windows
COMPRESSED = 15  # type of an element of a .mat file


def load(path):
    """Reads the layers of a file and its normalization, as (list of SimpleNamespace, struct of SciPy)."""
    path = existing(path)
    _check_unpacked(path)
    if current_process().daemon:  # daemons, e.g. of multiprocessing.Pool, must not have children
        return _load(path)
    # Reads in another process, because corrupted types of elements crash SciPy's compiled reader.
    with ProcessPoolExecutor(1, get_context('fork')) as other:
        try:
            return other.submit(_load, path).result()
        except BrokenProcessPool:
            raise InputError(f'{path}: not a readable .mat file: SciPy crashed in another process (corrupted file, or out of '
                             'memory)') from None


def _load(path):
    try:
        content = scipy.io.loadmat(str(path), struct_as_record=False)
    except NotImplementedError:
        raise InputError(f'{path}: .mat files of version 7.3 are not supported; save it with -v7 in MATLAB') from None
    except Exception as error:  # SciPy raises many types for corrupted files
        raise InputError(f'{path}: not a readable .mat file: {" ".join(str(error).split())[:200]}') from None
    root = _only(content['net']) if 'net' in content else SimpleNamespace(**content)
    if not hasattr(root, 'layers') or hasattr(root, 'params'):
        raise InputError(f"{path}: expected a SimpleNN network of MatConvNet ('layers', without 'params' of a DagNN)")
    layers = [_layer(path, i, _only(layer)) for i, layer in enumerate(np.ravel(root.layers), 1)]
    meta = _only(root.meta) if hasattr(root, 'meta') else root
    return layers, _only(getattr(meta, 'normalization', None))


def _check_unpacked(path):
    """Checks the decompressed size of a file of version 5, because SciPy has no limit."""
    size = 0
    with path.open('rb') as file:
        order = {b'IM': '<', b'MI': '>'}.get(file.read(128)[126:])
        while order and len(tag := file.read(8)) == 8:
            kind, left = struct.unpack(f'{order}II', tag)
            if kind != COMPRESSED:
                file.seek(left, 1)
                continue
            unpacker = zlib.decompressobj()
            while left and (part := file.read(min(left, 1 << 16))):
                left -= len(part)
                while part:
                    try:
                        size += len(unpacker.decompress(part, 1 << 24))
                    except zlib.error:
                        return  # SciPy reports it
                    check_unpacked(path, size)
                    part = unpacker.unconsumed_tail


def _only(value):
    """Returns the element of an array of size 1, else the array, because MATLAB has no scalars."""
    return value.flat[0] if isinstance(value, np.ndarray) and value.size == 1 else value


def _layer(path, index, layer):
    """Returns a layer with the defaults of vl_simplenn_tidy; arrays have the shapes of the file."""
    def get(name, default=None):
        return getattr(layer, name, default)
    kind, name = _only(get('type')), _only(get('name'))
    if not isinstance(kind, str):
        raise InputError(f'{path}: layer {index} has no type')
    result = SimpleNamespace(type=kind, name=name if isinstance(name, str) and name else f'{kind}{index}', path=path)
    try:
        if kind in ('conv', 'bnorm'):
            arrays = [get('filters'), get('biases')] if get('weights') is None else np.ravel(get('weights'))
            result.arrays = [np.asarray(array, np.float32) for array in arrays]
        result.pad = _numbers(get('pad', 0), 4, least=0)
        result.stride = _numbers(get('stride', 1), 2)
        result.dilate = _numbers(get('dilate', 1), 2)
        result.pool = _numbers(get('pool', 1), 2)
        result.method = _only(get('method', 'max'))
        result.leak = float(_only(get('leak', 0)))
        result.param = [float(value) for value in np.ravel(get('param', [5, 1, 0.0001 / 5, 0.75]))]
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError(f"{path}: layer '{name}' ({kind}): {error}") from None
    return result


def _numbers(value, n, least=1):
    values = [int(v) for v in np.ravel(value)]
    if len(values) not in (1, n) or any(v != w for v, w in zip(values, np.ravel(value))):
        raise ValueError(f'expected an integer, or {n}, found {value}')
    if min(values) < least or max(values) > MAX_PIXELS:
        raise ValueError(f'expected integers from {least} to {MAX_PIXELS}, found {value}')
    return values * n if len(values) == 1 else values


def refuse(layer, why):
    raise UnsupportedError(f"layer '{layer.name}' ({layer.type}): {why}")


def filters_of(layer):
    """Returns filters in Caffe's layout, [outputs][inputs][h][w], and biases or None. MATLAB drops trailing axes of size 1."""
    filters = layer.arrays[0].reshape(layer.arrays[0].shape + (1,) * (4 - layer.arrays[0].ndim))
    biases = layer.arrays[1].ravel() if len(layer.arrays) > 1 else np.zeros(0, np.float32)
    if filters.ndim != 4 or filters.size == 0 or biases.size not in (0, filters.shape[3]):
        raise InputError(f"{layer.path}: layer '{layer.name}': filters of shape {list(layer.arrays[0].shape)} do not match "
                         f'{biases.size} biases')
    return filters.transpose(3, 2, 0, 1), biases if biases.size else None


def _conv(net, layer, x):
    filters, biases = filters_of(layer)
    top, bottom, left, right = layer.pad
    if layer.dilate != [1, 1] and (top != bottom or left != right):
        refuse(layer, 'dilated convolutions with asymmetric padding are not supported')
    if layer.dilate[0] != layer.dilate[1]:
        refuse(layer, 'different dilations of rows and columns are not supported')
    # Caffe's padding is symmetric. Zeros at one end of the kernel compensate for the surplus padding on that side.
    grow = ((max(bottom - top, 0), max(top - bottom, 0)), (max(right - left, 0), max(left - right, 0)))
    if np.any(grow):
        filters = np.pad(filters, ((0, 0), (0, 0), *grow))
        print(f"'{layer.name}': converted the pad {layer.pad} to symmetric padding with a kernel of "
              f'{filters.shape[2]} x {filters.shape[3]}, extended by zeros')
    return net.convolution(layer.name, x, filters, biases, layer.stride, (max(top, bottom), max(left, right)), layer.dilate[0])


def _pool(net, layer, x):
    (top, bottom, left, right), (h, w), (down, across) = layer.pad, layer.pool, layer.stride
    if layer.method not in ('max', 'avg'):
        refuse(layer, f"expected method 'max' or 'avg', found '{layer.method}'")
    rounds = {_round_mode(layer, top, bottom, h, down), _round_mode(layer, left, right, w, across)} - {None}
    if len(rounds) > 1:
        refuse(layer, f'the pad {layer.pad} rounds the size up along one axis and down along the other; Caffe has one rounding')
    if layer.method == 'avg' and (top or left):
        refuse(layer, f'average pooling with the pad {layer.pad} is not supported: MatConvNet excludes the padding, Caffe does not')
    p = dict(pool='MAX' if layer.method == 'max' else 'AVE', kernel_h=h, kernel_w=w, stride_h=down, stride_w=across,
             pad_h=top, pad_w=left)
    if rounds == {False}:
        p['round_mode'] = 'FLOOR'
    return net.add(layer.name, 'Pooling', x, pooling_param=p)


def _round_mode(layer, before, after, kernel, stride):
    """Returns the rounding with which Caffe has MatConvNet's windows: True (up), False (down) or None (either).

    MatConvNet rounds down.
    """
    if before >= kernel:
        refuse(layer, f'expected a pad below the window size {kernel}, found {before}')
    if after == before:
        return None if stride == 1 else False
    if after == before + stride - 1 and before + stride <= kernel:  # Caffe's size, see onnx_layers/pooling.py
        return True
    return refuse(layer, f'the pad {layer.pad} with window size {kernel} and stride {stride} is not supported')


def _lrn(net, layer, x):
    if len(layer.param) != 4:
        refuse(layer, f'param: expected 4 numbers, found {len(layer.param)}')
    n, kappa, alpha, beta = layer.param
    if n != int(n) or n % 2 == 0:
        refuse(layer, f'expected an odd number of channels (Caffe), found {n:g}')
    return net.add(layer.name, 'LRN', x, lrn_param=dict(local_size=int(n), k=kappa, alpha=alpha * n, beta=beta))


def _bnorm(net, layer, x):
    if len(layer.arrays) != 3 or layer.arrays[2].size != 2 * layer.arrays[0].size:
        refuse(layer, 'moments are missing; normalization by batch statistics is not supported')
    factor, shift, moments = layer.arrays[0].ravel(), layer.arrays[1].ravel(), layer.arrays[2].reshape(-1, 2)
    # The second moment is the standard deviation and includes epsilon.
    mean, variance = moments[:, 0], np.square(moments[:, 1].astype(np.float64))
    x = net.add(layer.name, 'BatchNorm', x, [mean, variance, np.ones(1)], batch_norm_param=dict(eps=0))
    return net.add(f'{layer.name}_scale', 'Scale', x, [factor, shift], in_place=True, scale_param=dict(bias_term=True))


def _relu(net, layer, x):
    p = dict(relu_param=dict(negative_slope=layer.leak)) if layer.leak else {}
    return net.add(layer.name, 'ReLU', x, in_place=True, **p)


CONVERT = {
    'conv': _conv, 'pool': _pool, 'lrn': _lrn, 'normalize': _lrn, 'bnorm': _bnorm, 'relu': _relu,
    'dropout': lambda net, layer, x: x,
    'sigmoid': lambda net, layer, x: net.add(layer.name, 'Sigmoid', x, in_place=True),
    'softmax': lambda net, layer, x: net.add(layer.name, 'Softmax', x),
}


def convert(layers, input_shape, name):
    """Converts the layers of `load` to a NetWriter with an input of shape [1][channels][h][w]."""
    net, x = NetWriter(name, input_shape), 'data'
    for layer in layers:
        if layer.type not in CONVERT:
            refuse(layer, f'unsupported type; supported types: {", ".join(sorted(CONVERT))}')
        if layer.name in net.types():
            refuse(layer, 'duplicate layer name')
        x = CONVERT[layer.type](net, layer, x)
    if len(net.net.layer) < 2:
        raise Error('the file has no layers')
    return net


def input_shape(layers, normalization):
    """Returns [1][channels][h][w] from the metadata and the first convolution."""
    first = next((layer for layer in layers if layer.type == 'conv'), None)
    if first is None:
        raise InputError('input channels are unknown, because the network has no convolution')
    size = [int(v) for v in np.ravel(getattr(normalization, 'imageSize', [224, 224]))[:2]]
    return [1, filters_of(first)[0].shape[1], *size]


def mean_image(normalization):
    """Returns the mean image as [channels][h][w], or None."""
    image = getattr(normalization, 'averageImage', None)
    if image is None or np.size(image) == 0:
        return None
    image = np.asarray(image, np.float32)
    return image.transpose(2, 0, 1) if image.ndim == 3 else image.reshape(-1, 1, 1)


# NumPy reference of MatConvNet's layers, for the comparison.


def forward(layers, x):
    """Returns the output of the layers of `matconvnet.load` for x [n][c][h][w]."""
    x = x.astype(np.float64)
    for layer in layers:
        x = COMPUTE[layer.type](layer, x)
    return x


def _windows(layer, x, h, w, value):
    """Returns the windows of the padded image, [n][c][rows][columns][h][w]."""
    top, bottom, left, right = layer.pad
    down, across = layer.stride
    padded = np.pad(x, ((0, 0), (0, 0), (top, bottom), (left, right)), constant_values=value)
    return np.lib.stride_tricks.sliding_window_view(padded, (h, w), axis=(2, 3))[:, :, ::down, ::across]


def _conv(layer, x):
    filters, biases = filters_of(layer)
    outputs, per_group, h, w = filters.shape
    dilate = layer.dilate[0]
    seen = _windows(layer, x, (h - 1) * dilate + 1, (w - 1) * dilate + 1, 0)[..., ::dilate, ::dilate]
    groups = x.shape[1] // per_group
    parts = [np.einsum('nchwij,ocij->nohw', seen[:, g * per_group:(g + 1) * per_group],
                       filters[g * outputs // groups:(g + 1) * outputs // groups], optimize=True) for g in range(groups)]
    y = np.concatenate(parts, axis=1)
    return y if biases is None else y + biases[:, None, None]


def _pool(layer, x):
    """Maximum or average over the pixels of the image, without padding."""
    if layer.method == 'max':
        return _windows(layer, x, *layer.pool, -np.inf).max(axis=(4, 5))
    sums = _windows(layer, x, *layer.pool, 0).sum(axis=(4, 5))
    return sums / _windows(layer, np.ones_like(x[:1, :1]), *layer.pool, 0).sum(axis=(4, 5))


def _lrn(layer, x):
    n, kappa, alpha, beta = layer.param
    before = int((n - 1) // 2)
    squares = np.pad(x * x, ((0, 0), (before, int(n) - 1 - before), (0, 0), (0, 0)))
    sums = np.lib.stride_tricks.sliding_window_view(squares, int(n), axis=1).sum(axis=-1)
    return x / (kappa + alpha * sums) ** beta


def _bnorm(layer, x):
    factor, shift = layer.arrays[0].reshape(-1, 1, 1), layer.arrays[1].reshape(-1, 1, 1)
    mean, deviation = layer.arrays[2].reshape(-1, 2).T.reshape(2, -1, 1, 1)
    return (x - mean) / deviation * factor + shift


def _softmax(layer, x):
    powers = np.exp(x - x.max(axis=1, keepdims=True))
    return powers / powers.sum(axis=1, keepdims=True)


COMPUTE = {
    'conv': _conv, 'pool': _pool, 'lrn': _lrn, 'normalize': _lrn, 'bnorm': _bnorm, 'dropout': lambda layer, x: x,
    'relu': lambda layer, x: np.where(x > 0, x, layer.leak * x), 'sigmoid': lambda layer, x: 1 / (1 + np.exp(-x)),
    'softmax': _softmax,
}
