"""Mean images: Caffe's binaryproto and npy."""

from pathlib import Path

import numpy as np
from google.protobuf.message import DecodeError

from .errors import InputError
from .files import existing
from .npy import read_npy
from .schema import messages


def read(path):
    """A mean image as float32 [channels][height][width]."""
    path = existing(path)
    array = read_npy(path) if path.suffix.lower() == '.npy' else _read_binaryproto(path)
    if array.ndim == 4 and array.shape[0] == 1:
        array = array[0]
    if array.ndim not in (1, 3) or array.size == 0:
        raise InputError(f'{path}: a mean has the shape [channels][height][width], found {list(array.shape)}')
    return array.reshape(array.shape + (1,) * (3 - array.ndim))


def _read_binaryproto(path):
    try:
        blob = messages.BlobProto.FromString(path.read_bytes())
    except DecodeError:
        raise InputError(f'{path}: not a binaryproto file') from None
    shape = list(blob.shape.dim) if blob.HasField('shape') else [blob.num, blob.channels, blob.height, blob.width]
    values = np.array(blob.double_data or blob.data, np.float32)
    if values.size == 0 or min(shape, default=1) < 1 or values.size != np.prod(shape, dtype=np.int64):
        raise InputError(f'{path}: not a mean: {values.size} numbers in the shape {shape}')
    return values.reshape(shape)


def write(path, mean):
    """Writes a mean; the ending .npy or .binaryproto says how."""
    path = Path(path)
    if path.suffix.lower() == '.npy':
        with path.open('wb') as file:
            np.save(file, mean)
        return
    blob = messages.BlobProto(num=1, channels=mean.shape[0], height=mean.shape[1], width=mean.shape[2],
                              data=mean.ravel().tolist())
    path.write_bytes(blob.SerializeToString())
