"""Weights files: caffemodel, HDF5 in Caffe's layout (/data/LAYER/INDEX), and npz (LAYER/INDEX).

Weights are {layer: [array, ...]} in the order of the file, float32 by default.
"""

import tempfile
import zipfile
from pathlib import Path

import numpy as np

from revisit.caffe import _weights
from revisit.caffe.proto import caffe_pb2

from . import engine
from revisit.errors import Error, InputError, UsageError
from .compare import CheckFailed
from .files import appearing, existing, read_mean, read_npz, write_mean

FLOAT16_MAX = float(np.finfo(np.float16).max)
MAX_PROTOBUF_BYTES = 2**31 - 1

# Number of axes of the first array and of the others in Caffe. Files from before 2014 have four axes in every array.
LEGACY_AXES = {'Convolution': (4, 1), 'Deconvolution': (4, 1), 'InnerProduct': (2, 1)}


def is_npz(path):
    return Path(path).suffix.lower() == '.npz'


def read(path):
    """Reads weights in any format: npz by the extension, others by the content."""
    return read_with_types(path)[0]


def read_with_types(path):
    """Reads weights, and {layer: type} for the layers whose type the file has."""
    path = existing(path)
    if is_npz(path):
        return _read_npz(path), {}
    weights, types = engine.read_weights(path)
    for name, arrays in weights.items():
        if name != name.encode(errors='ignore').decode():
            raise InputError(f'{path}: expected layer names in UTF-8, found {name!r}')
        axes = LEGACY_AXES.get(types.get(name))
        for i, array in enumerate(arrays):
            extra = 4 - axes[min(i, 1)] if axes and array.ndim == 4 else 0
            if array.shape[:extra] == (1,) * extra:
                arrays[i] = array.reshape(array.shape[extra:])
    return weights, types


def write_caffemodel(path, weights, types=None):
    """Writes weights as a caffemodel in the current format. types: {layer: type}, informational."""
    size = sum(array.size * 4 for arrays in weights.values() for array in arrays)
    if size > MAX_PROTOBUF_BYTES:
        raise Error(f'caffemodel: expected at most 2 GB of weights, found {size} bytes; write .h5 or .npz')
    layers = [(caffe_pb2.LayerParameter(name=name, type=(types or {}).get(name, '')), arrays) for name, arrays in weights.items()]
    _weights.net_file('', layers).write_binary(path)


def write_h5(path, weights):
    """Writes weights in the layout of Caffe's Net::ToHDF5."""
    import h5py
    with h5py.File(path, 'w', libver='earliest') as file:
        data = file.create_group('data')
        for name, arrays in weights.items():
            for i, array in enumerate(arrays):
                data.create_dataset(f'{name}/{i}', data=array)


def write_npz(path, weights):
    """Writes weights as npz with the keys LAYER/INDEX."""
    with zipfile.ZipFile(path, 'w', zipfile.ZIP_STORED) as file:  # np.savez rejects the key 'file', a legal layer name
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
            raise InputError(f"{path}: expected keys LAYER/INDEX with ascending indices 0, 1, ..., found '{key}'")
        if array.dtype.kind not in 'fiu':
            raise InputError(f"{path}: '{key}': expected numbers, found {array.dtype}")
        arrays.append(array.astype(np.float32))
    return weights


def to_float16(weights):
    """Rounds weights to float16. Raises Error if they are out of range."""
    for name, arrays in weights.items():
        for array in arrays:
            largest = np.abs(array[np.isfinite(array)]).max(initial=0)
            if largest > FLOAT16_MAX:
                raise Error(f"layer '{name}': expected weights up to {FLOAT16_MAX:g} (float16), found {largest:g}")
    return {name: [array.astype(np.float16) for array in arrays] for name, arrays in weights.items()}


def write(path, weights, types=None):
    """Writes weights in the format of the file's extension."""
    if is_npz(path):
        write_npz(path, weights)
    elif Path(path).suffix.lower() == '.caffemodel':
        write_caffemodel(path, weights, types)
    else:
        write_h5(path, weights)


def for_engine(path, folder):
    """Returns a weights file for the engine: the file itself, or a converted caffemodel in `folder`."""
    if not is_npz(path):
        return path
    file = Path(tempfile.mkdtemp(dir=folder)) / 'same.caffemodel'
    write_caffemodel(file, read(path))
    return file


def require_same(found, expected):
    """Raises CheckFailed if weights that were read back differ from those written."""
    for name, arrays in expected.items():
        others = found.get(name, [])
        if len(arrays) != len(others) or not all(
                a.shape == b.shape and np.array_equal(a, b, equal_nan=True) for a, b in zip(arrays, others)):
            raise CheckFailed(f"check failed: layer '{name}' differs after reading back")
    if len(found) != len(expected):
        raise CheckFailed(f'check failed: expected {len(expected)} layers after reading back, found {len(found)}')


def convert(options):
    """Runs the command `weights`."""
    if options.float16 and not is_npz(options.output):
        raise UsageError('--float16: expected an .npz output; caffemodel and HDF5 files have float32 only')
    content, types = read_with_types(options.input_file)
    slashed = next((name for name in content if '/' in name), None)
    if slashed and Path(options.output).suffix.lower() in ('.h5', '.hdf5'):
        print(f"note: the original Caffe cannot read layer '{slashed}' from HDF5 because of the '/'; revisit can")
    stored = to_float16(content) if options.float16 else content
    with appearing(options.output) as [part]:
        write(part, stored, types)
        require_same(read(part), stored)
    arrays = [array for each in content.values() for array in each]
    print(f'{options.output}: {len(content)} layers, {sum(a.size for a in arrays)} numbers, verified by reading back')


def convert_mean(options):
    """Runs the command `mean`."""
    mean = read_mean(options.input_file)
    with appearing(options.output) as [part]:
        write_mean(part, mean)
        if not np.array_equal(read_mean(part), mean, equal_nan=True):
            raise CheckFailed(f'check failed: {options.output} differs from {options.input_file}')
    print(f'{options.output}: {"x".join(map(str, mean.shape))}, verified by reading back')
