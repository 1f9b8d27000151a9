"""Weights files: caffemodel, HDF5 in Caffe's layout (/data/LAYER/INDEX), and npz (LAYER/INDEX).

In memory weights are {layer: [array, ...]} in the order of the file, float32 unless said otherwise.
"""

import tempfile
import zipfile
from pathlib import Path

import numpy as np

from revisit.caffe import _caffemodel
from revisit.caffe.proto import caffe_pb2

from . import engine
from .errors import CheckFailed, Error, InputError, UsageError
from .files import existing
from .npy import read_npz

FLOAT16_MOST = float(np.finfo(np.float16).max)
MOST_PROTOBUF_BYTES = 2**31 - 1

# Files of before 2014 give every array four axes. What Caffe expects: axes of the first array, axes of the others.
LEGACY_AXES = {'Convolution': (4, 1), 'Deconvolution': (4, 1), 'InnerProduct': (2, 1)}


def kind_of(path):
    """'caffemodel', 'h5' or 'npz', by the ending of a file's name."""
    ending = Path(path).suffix.lower()
    kinds = {'.caffemodel': 'caffemodel', '.h5': 'h5', '.hdf5': 'h5', '.npz': 'npz'}
    if ending not in kinds:
        raise UsageError(f'{path}: the name must end in {", ".join(kinds)}')
    return kinds[ending]


def is_npz(path):
    return Path(path).suffix.lower() == '.npz'


def read(path):
    """The weights of a file of any of the formats. What is not npz by its name, its content says."""
    return read_with_types(path)[0]


def read_with_types(path):
    """The weights, and {layer: type} as far as the file says it."""
    path = existing(path)
    if is_npz(path):
        return _read_npz(path), {}
    weights, types = engine.read_weights(path)
    for name, arrays in weights.items():
        if name != name.encode(errors='ignore').decode():
            raise InputError(f'{path}: the name of a layer is not UTF-8 text: {name!r}')
        axes = LEGACY_AXES.get(types.get(name))
        for i, array in enumerate(arrays):
            extra = 4 - axes[min(i, 1)] if axes and array.ndim == 4 else 0
            if array.shape[:extra] == (1,) * extra:
                arrays[i] = array.reshape(array.shape[extra:])
    return weights, types


def write_caffemodel(path, weights, types=None):
    """Writes weights as a caffemodel of the current format. `types` {layer: type} are for people who look at the file."""
    size = sum(array.size * 4 for arrays in weights.values() for array in arrays)
    if size > MOST_PROTOBUF_BYTES:
        raise Error(f'{size} bytes of weights do not fit into a caffemodel (2 GB at most); write .h5 or .npz')
    layers = [(caffe_pb2.LayerParameter(name=name, type=(types or {}).get(name, '')), arrays) for name, arrays in weights.items()]
    with Path(path).open('wb') as file:
        file.writelines(_caffemodel.caffemodel('', layers))


def write_h5(path, weights):
    """Writes weights as Caffe's Net::ToHDF5 does."""
    import h5py
    with h5py.File(path, 'w', libver='earliest') as file:
        data = file.create_group('data')
        for name, arrays in weights.items():
            for i, array in enumerate(arrays):
                data.create_dataset(f'{name}/{i}', data=array)


def write_npz(path, weights):
    """Writes weights as npz with the keys LAYER/INDEX."""
    with zipfile.ZipFile(path, 'w', zipfile.ZIP_STORED) as file:  # np.savez takes no key 'file', a legal layer's name
        for name, arrays in weights.items():
            for i, array in enumerate(arrays):
                with file.open(f'{name}/{i}.npy', 'w', force_zip64=True) as entry:
                    np.lib.format.write_array(entry, np.asarray(array), allow_pickle=False)


def _read_npz(path):
    weights = {}
    for key, array in read_npz(path):
        name, _, index = key.rpartition('/')
        arrays = weights.setdefault(name, [])
        if not name or index != str(len(arrays)):
            raise InputError(f"{path}: the entry '{key}' is not LAYER/INDEX with indices 0, 1, ... in order")
        if array.dtype.kind not in 'fiu':
            raise InputError(f"{path}: '{key}' holds {array.dtype}, expected numbers")
        arrays.append(array.astype(np.float32))
    return weights


def to_float16(weights):
    """The weights rounded to float16."""
    for name, arrays in weights.items():
        for array in arrays:
            largest = np.abs(array[np.isfinite(array)]).max(initial=0)
            if largest > FLOAT16_MOST:
                raise Error(f"layer '{name}' has weights up to {largest:g}; float16 ends at {FLOAT16_MOST:g}")
    return {name: [array.astype(np.float16) for array in arrays] for name, arrays in weights.items()}


def write(path, weights, types=None):
    """Writes weights in the format that the ending of the file's name says."""
    kind = kind_of(path)
    if kind == 'caffemodel':
        write_caffemodel(path, weights, types)
    else:
        {'h5': write_h5, 'npz': write_npz}[kind](path, weights)


def for_engine(path, folder):
    """A file of these weights that the engine reads: the file itself, or a caffemodel in `folder`."""
    if not is_npz(path):
        return path
    file = Path(tempfile.mkdtemp(dir=folder)) / 'same.caffemodel'
    write_caffemodel(file, read(path))
    return file


def require_same(found, expected):
    """Ends with CheckFailed where weights that were read back are not those that were written."""
    for name, arrays in expected.items():
        others = found.get(name, [])
        if len(arrays) != len(others) or not all(
                a.shape == b.shape and np.array_equal(a, b, equal_nan=True) for a, b in zip(arrays, others)):
            raise CheckFailed(f"check failed: layer '{name}' is not the same when read back")
    if len(found) != len(expected):
        raise CheckFailed(f'check failed: {len(found)} layers when read back, {len(expected)} were written')
