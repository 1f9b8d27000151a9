"""Networks of MatConvNet (SimpleNN, .mat files) as Caffe networks.

The format: http://www.vlfeat.org/matconvnet/mfiles/simplenn/vl_simplenn/. Filters are [h][w][inputs / groups][outputs], pads
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

from .errors import Error, InputError, UnsupportedError
from .files import existing
from .net_writer import NetWriter
from .npy import check_unpacked


MOST_PIXELS = 1000  # of pads, strides and windows
COMPRESSED = 15  # an element of a .mat file


def load(path):
    """The layers of a file and its normalisation, as (list of SimpleNamespace, struct of SciPy)."""
    path = existing(path)
    _check_unpacked(path)
    if current_process().daemon:  # may have no children, as those of multiprocessing.Pool
        return _load(path)
    # In another process: SciPy's compiled reader follows damaged types of elements to nowhere.
    with ProcessPoolExecutor(1, get_context('fork')) as other:
        try:
            return other.submit(_load, path).result()
        except BrokenProcessPool:
            raise InputError(f'{path}: not a readable .mat file: the process that read it by SciPy was ended, as it is by damaged '
                             'files, or when memory is short') from None


def _load(path):
    try:
        content = scipy.io.loadmat(str(path), struct_as_record=False)
    except NotImplementedError:
        raise InputError(f'{path}: a .mat file of version 7.3; save it with -v7 in MATLAB') from None
    except Exception as error:  # SciPy has no type of its own for damaged files
        raise InputError(f'{path}: not a readable .mat file: {" ".join(str(error).split())[:200]}') from None
    root = _only(content['net']) if 'net' in content else SimpleNamespace(**content)
    if not hasattr(root, 'layers') or hasattr(root, 'params'):
        raise InputError(f"{path}: no SimpleNN network of MatConvNet: expected 'layers', and no 'params' of a DagNN")
    layers = [_layer(path, i, _only(layer)) for i, layer in enumerate(np.ravel(root.layers), 1)]
    meta = _only(root.meta) if hasattr(root, 'meta') else root
    return layers, _only(getattr(meta, 'normalization', None))


def _check_unpacked(path):
    """Unpacks the elements of a file of version 5 once, and keeps nothing: SciPy would take whatever they become."""
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
                        return  # SciPy says so
                    check_unpacked(path, size)
                    part = unpacker.unconsumed_tail


def _only(value):
    """MATLAB has no single things, only arrays: the one element of an array, or else the array."""
    return value.flat[0] if isinstance(value, np.ndarray) and value.size == 1 else value


def _layer(path, index, layer):
    """A layer with the fields that vl_simplenn_tidy fills in; arrays in the shapes of the file."""
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
        raise ValueError(f'expected a whole number, or {n}, found {value}')
    if min(values) < least or max(values) > MOST_PIXELS:
        raise ValueError(f'expected numbers from {least} to {MOST_PIXELS}, found {value}')
    return values * n if len(values) == 1 else values


def refuse(layer, why):
    raise UnsupportedError(f"layer '{layer.name}' ({layer.type}): {why}")


def filters_of(layer):
    """Filters as Caffe has them, [outputs][inputs][h][w], and biases (or None). MATLAB drops last axes of 1."""
    filters = layer.arrays[0].reshape(layer.arrays[0].shape + (1,) * (4 - layer.arrays[0].ndim))
    biases = layer.arrays[1].ravel() if len(layer.arrays) > 1 else np.zeros(0, np.float32)
    if filters.ndim != 4 or filters.size == 0 or biases.size not in (0, filters.shape[3]):
        raise InputError(f"{layer.path}: layer '{layer.name}' has filters of shape {list(layer.arrays[0].shape)} and "
                         f'{biases.size} biases')
    return filters.transpose(3, 2, 0, 1), biases if biases.size else None


def _conv(net, layer, x):
    filters, biases = filters_of(layer)
    top, bottom, left, right = layer.pad
    if layer.dilate != [1, 1] and (top != bottom or left != right):
        refuse(layer, 'a dilated convolution with a pad that differs between two sides')
    if layer.dilate[0] != layer.dilate[1]:
        refuse(layer, 'a dilation that differs between rows and columns')
    # Caffe pads alike: zeros at the kernel's end, or beginning, undo a surplus pad after, or before. Windows stay.
    grow = ((max(bottom - top, 0), max(top - bottom, 0)), (max(right - left, 0), max(left - right, 0)))
    if np.any(grow):
        filters = np.pad(filters, ((0, 0), (0, 0), *grow))
        print(f"'{layer.name}': its pad {layer.pad} became a pad on both sides and a kernel of "
              f'{filters.shape[2]} x {filters.shape[3]} with zeros')
    return net.convolution(layer.name, x, filters, biases, layer.stride, (max(top, bottom), max(left, right)), layer.dilate[0])


def _pool(net, layer, x):
    (top, bottom, left, right), (h, w), (down, across) = layer.pad, layer.pool, layer.stride
    if layer.method not in ('max', 'avg'):
        refuse(layer, f"method '{layer.method}'")
    rounds = {_round_mode(layer, top, bottom, h, down), _round_mode(layer, left, right, w, across)} - {None}
    if len(rounds) > 1:
        refuse(layer, f'the pad {layer.pad} rounds the size up along one axis and down along the other')
    if layer.method == 'avg' and (top or left):
        refuse(layer, f'an average with the pad {layer.pad}: MatConvNet does not count what is padded, Caffe does')
    p = dict(pool='MAX' if layer.method == 'max' else 'AVE', kernel_h=h, kernel_w=w, stride_h=down, stride_w=across,
             pad_h=top, pad_w=left)
    if rounds == {False}:
        p['round_mode'] = 'FLOOR'
    return net.add(layer.name, 'Pooling', x, pooling_param=p)


def _round_mode(layer, before, after, kernel, stride):
    """How Caffe has to round to have MatConvNet's windows: up, down, or (None) either. MatConvNet rounds down."""
    if before >= kernel:
        refuse(layer, f'a pad of {before} before a window of {kernel}')
    if after == before:
        return None if stride == 1 else False
    if after == before + stride - 1 and before + stride <= kernel:  # Caffe's size, see onnx_layers/pooling.py
        return True
    return refuse(layer, f'the pad {layer.pad} with a window of {kernel} and a stride of {stride}')


def _lrn(net, layer, x):
    if len(layer.param) != 4:
        refuse(layer, f'expected a param of 4 numbers, found {len(layer.param)}')
    n, kappa, alpha, beta = layer.param
    if n != int(n) or n % 2 == 0:
        refuse(layer, f'a group of {n:g} channels; Caffe takes odd numbers')
    return net.add(layer.name, 'LRN', x, lrn_param=dict(local_size=int(n), k=kappa, alpha=alpha * n, beta=beta))


def _bnorm(net, layer, x):
    if len(layer.arrays) != 3 or layer.arrays[2].size != 2 * layer.arrays[0].size:
        refuse(layer, 'moments are missing: without them it normalises by the batch at hand')
    factor, shift, moments = layer.arrays[0].ravel(), layer.arrays[1].ravel(), layer.arrays[2].reshape(-1, 2)
    # The second moment is the deviation, with epsilon in it already.
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
    """The layers of `load` as a NetWriter with an input of the shape [1][channels][h][w]."""
    net, x = NetWriter(name, input_shape), 'data'
    for layer in layers:
        if layer.type not in CONVERT:
            refuse(layer, f'this type is not converted; those that are: {", ".join(sorted(CONVERT))}')
        if layer.name in net.types():
            refuse(layer, 'two layers have this name')
        x = CONVERT[layer.type](net, layer, x)
    if len(net.net.layer) < 2:
        raise Error('the file holds no layers')
    return net


def input_shape(layers, normalization):
    """[1][channels][h][w], of the meta data and the first convolution."""
    first = next((layer for layer in layers if layer.type == 'conv'), None)
    if first is None:
        raise InputError('the network has no convolution, so the channels of its input are not known')
    size = [int(v) for v in np.ravel(getattr(normalization, 'imageSize', [224, 224]))[:2]]
    return [1, filters_of(first)[0].shape[1], *size]


def mean_image(normalization):
    """The average image as [channels][h][w], or None."""
    image = getattr(normalization, 'averageImage', None)
    if image is None or np.size(image) == 0:
        return None
    image = np.asarray(image, np.float32)
    return image.transpose(2, 0, 1) if image.ndim == 3 else image.reshape(-1, 1, 1)
