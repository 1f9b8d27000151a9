"""Weights as the bytes of a caffemodel.

protobuf's own Python classes take minutes for the weights of a large net, number by number. What stands around the
numbers is little, so it is written here. https://protobuf.dev/programming-guides/encoding has the encoding.
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
    """A field with a length, as chunks."""
    length = sum(len(chunk) for chunk in chunks)
    return [_varint(number << 3 | 2) + _varint(length), *chunks]


def _blob(array):
    array = np.asarray(array, '<f4', order='C')
    head = caffe_pb2.BlobProto()
    head.shape.dim.extend(array.shape)
    head.shape.SetInParent()  # also of a scalar
    return [head.SerializeToString(), *_field(_DATA, [memoryview(array.reshape(-1)).cast('B')])]


def caffemodel(name, layers):
    """The parts of a caffemodel, to be written one after the other.

    Args:
        name: the net's.
        layers: a LayerParameter without blobs, and a list of arrays, for each layer.
    Raises:
        ValueError: a caffemodel of more than 2^31 - 1 bytes, which nobody could read.
    """
    chunks = [caffe_pb2.NetParameter(name=name).SerializeToString()]
    for message, arrays in layers:
        parts = [message.SerializeToString()]
        for array in arrays:
            parts += _field(_BLOBS, _blob(array))
        chunks += _field(_LAYER, parts)
    size = sum(len(chunk) for chunk in chunks)
    if size > _LARGEST:
        raise ValueError(f'a caffemodel has at most {_LARGEST} bytes, these weights take {size}; use save_hdf5()')
    return chunks


def in_memory(arrays):
    """The bytes of a caffemodel for the engine. `arrays`: lists of arrays by name of layer."""
    layers = [(caffe_pb2.LayerParameter(name=name), blobs) for name, blobs in arrays.items()]
    # A file without layers is not a caffemodel.
    return b''.join(caffemodel('net', layers or [(caffe_pb2.LayerParameter(name='none'), [])]))
