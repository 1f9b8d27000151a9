"""CompressedPointCloud2 of point_cloud_transport: Draco, zlib and zstd."""

import sys
import zlib
from types import SimpleNamespace

import numpy as np

from revisit.errors import InputError
from revisit.recordings.point_cloud2 import TYPES
from revisit.recordings.recording import package

COMPRESSED = 'point_cloud_interfaces/msg/CompressedPointCloud2'
DEFINITIONS = {
    COMPRESSED: 'std_msgs/Header header\nuint32 height\nuint32 width\nsensor_msgs/PointField[] fields\nbool is_bigendian\n'
                'uint32 point_step\nuint32 row_step\nuint8[] compressed_data\nbool is_dense\nstring format\n'}
MAX_RATIO = 1000
"""Allowed compression ratio: zeros of a missing return have some hundred."""


def unpacked(message, decompress):
    """decompress(data, max_length): bytes."""
    data, size = message.compressed_data.tobytes(), max(message.row_step, message.width * message.point_step) * message.height
    if size > MAX_RATIO * len(data):
        raise InputError(f'CompressedPointCloud2: {len(data)} compressed bytes of {size} (decompression bomb)')
    try:
        content = decompress(data, size)
    except Exception as error:  # of the package
        raise InputError(f'CompressedPointCloud2: cannot be decompressed as {message.format}: {error}') from None
    return vars(message) | {'data': np.frombuffer(content, np.uint8)}


def zstd_decompressor():
    name = 'compression.zstd' if sys.version_info >= (3, 14) else 'backports.zstd'
    return package(name, 'backports.zstd', 'reading clouds compressed by zstd').ZstdDecompressor()


def from_draco(message):
    """The attributes of draco_point_cloud_transport are the fields in their order, the points without duplicates."""
    draco = package('DracoPy', 'DracoPy', 'reading clouds compressed by Draco')
    try:
        attributes = draco.decode(message.compressed_data.tobytes()).attributes
    except Exception as error:  # of the package
        raise InputError(f'CompressedPointCloud2: cannot be decompressed as draco: {error}') from None
    if len(attributes) != len(message.fields) or len({len(attribute['data']) for attribute in attributes}) != 1:
        raise InputError(f'CompressedPointCloud2: expected an attribute for each of {len(message.fields)} fields, '
                         f'found {len(attributes)}')
    fields, columns, offset = [], [], 0
    codes = {name: code for code, name in TYPES.items()}
    for field, attribute in zip(message.fields, attributes):
        values = attribute['data']
        fields.append(SimpleNamespace(name=field.name, offset=offset, datatype=codes[values.dtype.name], count=values.shape[1]))
        columns.append(np.ascontiguousarray(values).view(np.uint8).reshape(len(values), -1))
        offset += columns[-1].shape[1]
    data = np.concatenate(columns, 1)
    return {'height': 1, 'width': len(data), 'fields': fields, 'is_bigendian': False, 'point_step': offset, 'row_step': data.size,
            'data': data.reshape(-1)}


def decompressed(message):
    """Returns the values of a PointCloud2. Raises InputError, and Error with the name of a missing package."""
    if message.format == 'draco':
        return SimpleNamespace(**from_draco(message))
    if message.format == 'zlib':
        return SimpleNamespace(**unpacked(message, zlib.decompressobj(zlib.MAX_WBITS | 32).decompress))
    if message.format == 'zstd':
        return SimpleNamespace(**unpacked(message, zstd_decompressor().decompress))
    raise InputError(f'CompressedPointCloud2: expected draco, zlib or zstd, found {message.format!r}')
