"""caffe.io: conversion of images and messages to arrays, and preprocessing.

Images are float32 arrays [h][w][c], usually in [0, 1], with channels in RGB order.
"""

import numpy as np

from ._resizing import oversample, resize_image
from ._transformer import Transformer
from .proto import caffe_pb2


def blobproto_to_array(blob, return_diff=False):
    """Returns the values or gradients of a BlobProto in its shape, which may be given as num, channels, height, width."""
    values = np.array(blob.diff if return_diff else blob.data)
    if any(blob.HasField(name) for name in ('num', 'channels', 'height', 'width')):
        return values.reshape(blob.num, blob.channels, blob.height, blob.width)
    return values.reshape(tuple(blob.shape.dim))


def array_to_blobproto(arr, diff=None):
    """Converts an array of any shape, and gradients of the same shape, to a BlobProto."""
    blob, arr = caffe_pb2.BlobProto(), np.asarray(arr, float)
    blob.shape.dim.extend(arr.shape)
    blob.data.extend(arr.ravel())
    if diff is not None:
        blob.diff.extend(np.asarray(diff, float).ravel())
    return blob


def arraylist_to_blobprotovector_str(arraylist):
    """Serializes arrays as a BlobProtoVector."""
    return caffe_pb2.BlobProtoVector(blobs=map(array_to_blobproto, arraylist)).SerializeToString()


def blobprotovector_str_to_arraylist(str):
    """Parses the arrays of a serialized BlobProtoVector."""
    return [blobproto_to_array(blob) for blob in caffe_pb2.BlobProtoVector.FromString(str).blobs]


def array_to_datum(arr, label=None):
    """Converts an array [c][h][w] to a Datum, with bytes for uint8, else floats."""
    arr = np.asarray(arr)
    if arr.ndim != 3:
        raise ValueError(f'array_to_datum: expected an array of 3 axes (channels, height, width), found shape {arr.shape}')
    datum = caffe_pb2.Datum(channels=arr.shape[0], height=arr.shape[1], width=arr.shape[2])
    if arr.dtype == np.uint8:
        datum.data = arr.tobytes()
    else:
        datum.float_data.extend(arr.astype(float).flat)
    if label is not None:
        datum.label = label
    return datum


def datum_to_array(datum):
    """Returns the array [c][h][w] of a Datum: uint8 for bytes, else float64. The label is datum.label."""
    if datum.encoded:
        raise ValueError('datum_to_array: the Datum has an encoded image; decode datum.data with an image library')
    if datum.data:
        values = np.frombuffer(datum.data, np.uint8).copy()
    else:
        values = np.array(datum.float_data, float)
    return values.reshape(datum.channels, datum.height, datum.width)


def load_image(filename, color=True):
    """Reads an image file as float32 in [0, 1]: [h][w][3] in RGB, or [h][w][1] with color=False. Needs the package pillow.

    Drops transparency, as pycaffe does.
    """
    try:
        from PIL import Image
    except ImportError as error:
        raise ImportError('load_image() needs the package pillow: pip install pillow') from error
    with Image.open(filename) as file:
        pixels = _pixels(file)
    values = pixels.astype(np.float32) / np.float32(65535 if pixels.dtype == np.uint16 else 255)
    if values.ndim == 2:
        return np.repeat(values[:, :, np.newaxis], 3 if color else 1, axis=2)
    if color:
        return values
    return (values @ np.float32([0.2125, 0.7154, 0.0721]))[:, :, np.newaxis]  # ITU-R BT.709 luminance


def _pixels(image):
    """Returns uint8 or uint16, [h][w] for grayscale or [h][w][3]."""
    if image.mode.startswith('I'):
        return np.asarray(image).astype(np.uint16)
    if image.mode in ('1', 'L', 'LA'):
        return np.asarray(image.convert('L'))
    if image.mode == 'RGBA':
        return np.asarray(image)[:, :, :3]
    return np.asarray(image.convert('RGB'))
