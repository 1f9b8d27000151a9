"""Atomic writing of files; npy and npz files, and mean images."""

import os
import tempfile
from contextlib import ExitStack, contextmanager
from pathlib import Path

import numpy as np

from revisit.caffe.proto import caffe_pb2
from revisit.errors import Error, InputError, UsageError
from revisit.proto import read_binaryproto


def existing(path):
    """Returns the path. Raises InputError unless it is a readable file."""
    path = Path(path)
    try:
        with path.open('rb') as file:
            file.read(1)
    except OSError as error:
        raise InputError(f'{path}: cannot open: {error.strerror}') from None
    return path


def may_write(outputs):
    """Raises UsageError if an output cannot be written or exists. outputs: pairs (path, endings that its name may have or ())."""
    for name, endings in outputs:
        path = Path(name)
        if endings and path.suffix.lower() not in endings:
            raise UsageError(f'{path}: the name must end in {" or ".join(endings)}')
        if path.exists():
            raise UsageError(f'{path}: already exists; remove it, or write another file')
        if not path.parent.is_dir():
            raise UsageError(f'{path}: no folder {path.parent}')


@contextmanager
def appearing(*paths):
    """Yields one temporary path per path, and renames them when the block ends without an exception."""
    paths = [Path(path).resolve() for path in paths]
    try:
        with ExitStack() as stack:
            parts = [Path(stack.enter_context(tempfile.TemporaryDirectory(dir=path.parent, prefix='.revisit-convert-'))) / path.name
                     for path in paths]
            yield parts
            for part, path in zip(parts, paths):
                os.replace(part, path)
    except OSError as error:
        raise Error(f'{paths[0]}: cannot write: {error.strerror or error}') from None


def read_npy(path):
    """Reads an npy file of numbers as float32."""
    try:
        array = np.load(existing(path), allow_pickle=False)
    except InputError:
        raise
    except Exception as error:  # NumPy parses the header as Python, which raises many types
        raise InputError(f'{path}: not a readable npy file: {" ".join(str(error).split())[:200]}') from None
    if not isinstance(array, np.ndarray) or array.dtype.kind not in 'fiu':
        raise InputError(f'{path}: expected an npy file of numbers, found {getattr(array, "dtype", "several arrays")}')
    return array.astype(np.float32)


FREE_BYTES, MAX_RATIO = 1 << 30, 100
"""Decompressed size that is always allowed, and allowed compression ratio beyond it. Zeros have a ratio of a thousand."""


def check_unpacked(path, size):
    """Raises InputError if the decompressed size is implausible for trained weights."""
    packed = path.stat().st_size
    if size > max(FREE_BYTES, MAX_RATIO * packed):
        raise InputError(f'{path}: {packed} compressed bytes expand to {size} or more, over {MAX_RATIO} times as many '
                         '(decompression bomb); store valid content without compression')


def read_npz(path):
    """Yields (key, array) for each entry of an npz file, in the order of the file."""
    path = existing(path)
    try:
        with path.open('rb') as opened, np.lib.npyio.NpzFile(opened, own_fid=False, allow_pickle=False) as file:
            check_unpacked(path, sum(entry.file_size for entry in file.zip.infolist()))
            seen = set()
            for key in file.files:
                if key in seen:
                    raise InputError(f"{path}: duplicate entry '{key}'")
                seen.add(key)
                array = file[key]
                if not isinstance(array, np.ndarray):
                    raise InputError(f"{path}: entry '{key}' is not an array in npy format")
                yield key, array
    except InputError:
        raise
    except Exception as error:  # zipfile, its decompressors and NumPy raise many types
        raise InputError(f'{path}: not a readable npz file: {" ".join(str(error).split())[:200]}') from None


def read_mean(path):
    """Reads a mean image as float32 [channels][height][width]."""
    path = existing(path)
    array = read_npy(path) if path.suffix.lower() == '.npy' else read_binaryproto(path)
    if array.ndim == 4 and array.shape[0] == 1:
        array = array[0]
    if array.ndim not in (1, 3) or array.size == 0:
        raise InputError(f'{path}: expected a mean of shape [channels][height][width], found {list(array.shape)}')
    return array.reshape(array.shape + (1,) * (3 - array.ndim))


def write_mean(path, mean):
    """Writes a mean image. The format follows from the extension, .npy or .binaryproto."""
    path = Path(path)
    if path.suffix.lower() == '.npy':
        with path.open('wb') as file:
            np.save(file, mean)
        return
    blob = caffe_pb2.BlobProto(num=1, channels=mean.shape[0], height=mean.shape[1], width=mean.shape[2],
                              data=mean.ravel().tolist())
    path.write_bytes(blob.SerializeToString())
