"""Zero-copy access to the points of a sensor_msgs/PointCloud2."""

import numpy as np

from revisit.errors import InputError
from revisit.recordings.recording import time_names, times_of

FLOATS = {7: 'f4', 8: 'f8'}
TYPES = {1: 'int8', 2: 'uint8', 3: 'int16', 4: 'uint16', 5: 'int32', 6: 'uint32', 7: 'float32', 8: 'float64'}


def fields_of(message):
    """Returns offset [bytes] and dtype of x, y and z. Raises InputError if one is missing or not floating-point."""
    by_name = {field.name: field for field in message.fields}
    found = []
    for axis in 'xyz':
        field = by_name.get(axis)
        if field is None:
            raise InputError(f'PointCloud2: expected a field {axis}, found {", ".join(by_name) or "none"}')
        if field.datatype not in FLOATS or field.count > 1:
            count = f' x {field.count}' if field.count > 1 else ''
            raise InputError(f'PointCloud2: field {axis}: expected float32 or float64, found '
                             f'{TYPES.get(field.datatype, field.datatype)}{count}')
        number = np.dtype(('>' if message.is_bigendian else '<') + FLOATS[field.datatype])
        if field.offset + number.itemsize > message.point_step:
            raise InputError(f'PointCloud2: field {axis} ends at byte {field.offset + number.itemsize}, beyond point_step '
                             f'{message.point_step}')
        found.append((field.offset, number))
    return found


def time_field(message):
    """Returns offset [bytes] and dtype of the time of a point, or None."""
    for name in time_names([field.name for field in message.fields]):
        for field in message.fields:
            if field.name == name and field.count <= 1 and field.datatype in TYPES:
                number = np.dtype(TYPES[field.datatype]).newbyteorder('>' if message.is_bigendian else '<')
                if field.offset + number.itemsize <= message.point_step:
                    return field.offset, number
    return None


def points_of(message, stamp=None):
    """Returns points, float32 [n][3], and their times relative to the stamp, float32 [n] [s], or None.

    message: of rosbags or ROS. NaN is kept; an organized cloud is read row by row. Points are not copied if x, y, z are
    float32 in native byte order, evenly spaced, and rows have no padding. Raises InputError for a truncated message.
    """
    width, height, step = message.width, message.height, message.point_step
    if width * height == 0:  # some drivers omit the fields of an empty cloud
        return np.empty((0, 3), np.float32), None
    fields = fields_of(message)
    row = message.row_step if height > 1 else width * step  # drivers may leave row_step unset for one row
    data = np.frombuffer(message.data, np.uint8)
    if row < width * step or (height - 1) * row + width * step > data.size:
        raise InputError(f'PointCloud2: expected {height} x {width} points of {step} bytes in rows of {row}, found {data.size} bytes')
    (x, number), (y, of_y), (z, of_z) = fields
    if number == of_y == of_z and y - x == z - y > 0:
        shape, strides = (height, width, 3), (row, step, y - x)
        points = np.ndarray(shape, number, data, x, strides)
    else:
        points = np.stack([np.ndarray((height, width), of, data, offset, (row, step)) for offset, of in fields], -1)
    times = None
    if of_time := time_field(message):
        times = times_of(np.ndarray((height, width), of_time[1], data, of_time[0], (row, step)), stamp)
    return points.reshape(-1, 3).astype(np.float32, copy=False), times
