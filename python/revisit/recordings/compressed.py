"""CompressedPointCloud2 of point_cloud_transport: Draco, zlib and zstd."""

import sys
import zlib
from types import SimpleNamespace

import numpy as np

from revisit.errors import Error, InputError
from revisit.recordings.point_cloud2 import TYPES
from revisit.recordings.recording import package

COMPRESSED = 'point_cloud_interfaces/msg/CompressedPointCloud2'
DEFINITIONS = {
    COMPRESSED: 'std_msgs/Header header\nuint32 height\nuint32 width\nsensor_msgs/PointField[] fields\nbool is_bigendian\n'
                'uint32 point_step\nuint32 row_step\nuint8[] compressed_data\nbool is_dense\nstring format\n'}
CODES = {name: code for code, name in TYPES.items()}
MAX_RATIO = 1000
"""Allowed compression ratio: zeros of a missing return have some hundred."""


def zstd_decompressor():
    name = 'compression.zstd' if sys.version_info >= (3, 14) else 'backports.zstd'
    return package(name, 'backports.zstd', 'reading clouds compressed by zstd').ZstdDecompressor()


def unpacked(message, decompressor):
    data, packed = message.compressed_data.tobytes(), message.width * message.point_step
    size = max(packed, min(message.row_step, 2 * packed)) * message.height  # row_step may be nonsense
    if size > MAX_RATIO * len(data):
        raise ValueError(f'{len(data)} bytes expand to {size} (decompression bomb)')
    return SimpleNamespace(**vars(message) | {'data': np.frombuffer(decompressor.decompress(data, size), np.uint8)})


def from_draco(message, draco):
    """The attributes of draco_point_cloud_transport are the fields in their order, the points without duplicates."""
    columns = [attribute['data'] for attribute in draco.decode(message.compressed_data.tobytes()).attributes]
    if len(columns) != len(message.fields) or len({len(column) for column in columns}) != 1:
        raise ValueError(f'expected an attribute for each of {len(message.fields)} fields, found {len(columns)}')
    records = np.empty(len(columns[0]), [(str(i), column.dtype, column.shape[1:]) for i, column in enumerate(columns)])
    fields = []
    for i, (field, column) in enumerate(zip(message.fields, columns)):
        records[str(i)] = column
        fields.append(SimpleNamespace(name=field.name, offset=records.dtype.fields[str(i)][1], datatype=CODES[column.dtype.name],
                                      count=column.shape[1]))
    return SimpleNamespace(height=1, width=len(records), fields=fields, is_bigendian=False, point_step=records.itemsize,
                           row_step=records.nbytes, data=records.view(np.uint8))


def decompressed(message):
    """Returns the values of a PointCloud2. Raises InputError, and Error with the name of a missing package."""
    if message.format not in ('draco', 'zlib', 'zstd'):
        raise InputError(f'CompressedPointCloud2: expected draco, zlib or zstd, found {message.format!r}')
    try:
        if message.format == 'draco':
            return from_draco(message, package('DracoPy', 'DracoPy', 'reading clouds compressed by Draco'))
        return unpacked(message, zstd_decompressor() if message.format == 'zstd' else zlib.decompressobj(zlib.MAX_WBITS | 32))
    except Error:
        raise
    except Exception as error:  # of the packages
        raise InputError(f'CompressedPointCloud2: cannot be decompressed as {message.format}: {error}') from None
