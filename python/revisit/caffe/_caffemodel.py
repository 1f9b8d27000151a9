"""Serialization of weights as a caffemodel.

This module encodes the messages itself, because protobuf's Python classes need minutes for the weights of a large net.
Encoding: https://protobuf.dev/programming-guides/encoding
"""

import numpy as np

from .proto import caffe_pb2

_LAYER = caffe_pb2.NetParameter.DESCRIPTOR.fields_by_name['layer'].number
_BLOBS = caffe_pb2.LayerParameter.DESCRIPTOR.fields_by_name['blobs'].number
_DATA = caffe_pb2.BlobProto.DESCRIPTOR.fields_by_name['data'].number
_LARGEST = 2**31 - 1  # [bytes] of a message


def _varint(number):
    out = bytearray()
    while number > 0x7F:
        out.append(number & 0x7F | 0x80)
        number >>= 7
    out.append(number)
    return bytes(out)


def _field(number, chunks):
    """Returns a length-delimited field as chunks."""
    length = sum(len(chunk) for chunk in chunks)
    return [_varint(number << 3 | 2) + _varint(length), *chunks]


def _blob(array):
    array = np.asarray(array, '<f4', order='C')
    head = caffe_pb2.BlobProto()
    head.shape.dim.extend(array.shape)
    head.shape.SetInParent()  # for scalars, too
    return [head.SerializeToString(), *_field(_DATA, [memoryview(array.reshape(-1)).cast('B')])]


def caffemodel(name, layers):
    """Returns chunks. layers: pairs of a LayerParameter without blobs and a list of arrays.

    Raises ValueError if the caffemodel would exceed protobuf's limit of 2^31 - 1 bytes.
    """
    chunks = [caffe_pb2.NetParameter(name=name).SerializeToString()]
    for message, arrays in layers:
        parts = [message.SerializeToString()]
        for array in arrays:
            parts += _field(_BLOBS, _blob(array))
        chunks += _field(_LAYER, parts)
    size = sum(len(chunk) for chunk in chunks)
    if size > _LARGEST:
        raise ValueError(f'caffemodel: expected at most {_LARGEST} bytes, found {size}; use save_hdf5()')
    return chunks


def in_memory(arrays):
    """Returns the bytes of a caffemodel for the engine. arrays: layer name -> list of arrays."""
    layers = [(caffe_pb2.LayerParameter(name=name), blobs) for name, blobs in arrays.items()]
    # A caffemodel needs at least one layer.
    return b''.join(caffemodel('net', layers or [(caffe_pb2.LayerParameter(name='none'), [])]))
