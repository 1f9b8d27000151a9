"""Mean images in Caffe's binaryproto and in npy."""

from pathlib import Path

import numpy as np

from revisit.caffe.proto import caffe_pb2
from revisit.proto import read_binaryproto

from .errors import InputError
from .files import existing
from .npy import read_npy


def read(path):
    """Reads a mean image as float32 [channels][height][width]."""
    path = existing(path)
    array = read_npy(path) if path.suffix.lower() == '.npy' else read_binaryproto(path)
    if array.ndim == 4 and array.shape[0] == 1:
        array = array[0]
    if array.ndim not in (1, 3) or array.size == 0:
        raise InputError(f'{path}: expected a mean of shape [channels][height][width], found {list(array.shape)}')
    return array.reshape(array.shape + (1,) * (3 - array.ndim))


def write(path, mean):
    """Writes a mean image. The format follows from the extension, .npy or .binaryproto."""
    path = Path(path)
    if path.suffix.lower() == '.npy':
        with path.open('wb') as file:
            np.save(file, mean)
        return
    blob = caffe_pb2.BlobProto(num=1, channels=mean.shape[0], height=mean.shape[1], width=mean.shape[2],
                              data=mean.ravel().tolist())
    path.write_bytes(blob.SerializeToString())
