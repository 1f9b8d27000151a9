"""Synthetic bags, written by rosbags, and their messages."""

from types import SimpleNamespace

import numpy as np

try:
    from rosbags.rosbag2 import StoragePlugin  # missing in older versions
    HAVE_ROSBAGS = True
except ImportError:
    HAVE_ROSBAGS = False
CLOUD = 'sensor_msgs/msg/PointCloud2'
START = 1700000000
"""Time of the first message [s]; the interval is 0.1 s."""
KINDS = ('ros1', 'sqlite3', 'mcap', 'lone mcap', 'lone db3')


def stamp(frame):
    return START + frame // 10, frame % 10 * 100000000


def packed(points, offsets=(0, 4, 8), step=16, types='fff', order='<', height=1, pad=0, start=b''):
    """Returns a PointCloud2 as plain values: points [n][3] at offsets in records of `step` bytes, rows padded by `pad` bytes."""
    n = len(points)
    data = np.full((n, step), 7, np.uint8)
    for axis, (offset, kind) in enumerate(zip(offsets, types)):
        number = np.dtype(order + {'f': 'f4', 'd': 'f8', 'i': 'i4'}[kind])
        data[:, offset:offset + number.itemsize] = points[:, axis].astype(number)[:, None].view(np.uint8)
    rows = np.full((height, n // height * step + pad), 9, np.uint8)
    rows[:, :n // height * step] = data.reshape(height, -1)
    codes = {'f': 7, 'd': 8, 'i': 5}
    return SimpleNamespace(
        height=height, width=n // height, is_bigendian=order == '>', point_step=step, row_step=rows.shape[1], is_dense=True,
        data=rows.reshape(-1),
        fields=[SimpleNamespace(name=name, offset=offset, datatype=codes[kind], count=1)
                for name, offset, kind in zip('xyz', offsets, types)])


def placed(cloud, frame_id, late=0.0):
    """Returns a cloud of packed() of another sensor, `late` seconds after those of the first."""
    return SimpleNamespace(**vars(cloud), frame_id=frame_id, late=late)


def message(store, cloud, frame, ros1, stamped=True):
    make = {name: store.types[f'{package}/msg/{name}'] for package, name in (
        ('builtin_interfaces', 'Time'), ('sensor_msgs', 'PointField'), ('sensor_msgs', 'PointCloud2'))}
    start = header(store, frame, ros1)
    start.stamp = start.stamp if stamped else make['Time'](0, 0)
    values = dict(vars(cloud))
    start.stamp.nanosec += round(values.pop('late', 0) * 1e9)
    start.frame_id = values.pop('frame_id', 'lidar')
    values |= {'fields': [make['PointField'](**vars(field)) for field in cloud.fields]}
    return make['PointCloud2'](header=start, **values)


def writer_of(path, ros1, plugin=None):
    from rosbags.rosbag1 import Writer as Writer1
    from rosbags.rosbag2 import Writer as Writer2
    return Writer1(path) if ros1 else Writer2(path, version=9, storage_plugin=plugin or StoragePlugin.MCAP)


def store_with(ros1, definitions=()):
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore
    store = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.LATEST)
    for name, definition in definitions:
        store.register(get_types_from_msg(definition, name))
    return store


def write_messages(path, ros1, store, topic, kind, messages):
    """Writes the messages at the stamps of their frames. Returns the path."""
    serialize = store.serialize_ros1 if ros1 else store.serialize_cdr
    with writer_of(path, ros1) as writer:
        connection = writer.add_connection(topic, kind, typestore=store)
        for frame, content in enumerate(messages):
            seconds, nano = stamp(frame)
            writer.write(connection, seconds * 10**9 + nano, serialize(content, kind))
    return path


def header(store, frame, ros1):
    time = store.types['builtin_interfaces/msg/Time'](*stamp(frame))
    return store.types['std_msgs/msg/Header'](**({'seq': frame} if ros1 else {}), stamp=time, frame_id='lidar')


def write_livox(folder, ros1, package, clouds, tags):
    """Writes a bag of CustomMsg with a point every 0.5 ms."""
    point, custom = f'{package}/msg/CustomPoint', f'{package}/msg/CustomMsg'
    store = store_with(ros1, [
        (point, 'uint32 offset_time\nfloat32 x\nfloat32 y\nfloat32 z\nuint8 reflectivity\nuint8 tag\nuint8 line\n'),
        (custom, 'std_msgs/Header header\nuint64 timebase\nuint32 point_num\nuint8 lidar_id\nuint8[3] rsvd\n'
                 f'{package}/CustomPoint[] points\n')])

    def message_of(frame, cloud):
        seconds, nano = stamp(frame)
        points = [store.types[point](i * 500000, *map(float, xyz), 9, tag, 0) for i, (xyz, tag) in enumerate(zip(cloud, tags))]
        return store.types[custom](header(store, frame, ros1), seconds * 10**9 + nano, len(points), 0, np.zeros(3, np.uint8), points)

    return write_messages(folder / f'{package}{"1.bag" if ros1 else "2"}', ros1, store, '/livox/lidar', custom,
                          [message_of(frame, cloud) for frame, cloud in enumerate(clouds)])


def draco_of(data):
    """Encodes records of x, y, z, t as draco_point_cloud_transport does, an attribute for each field, without prediction."""
    records = np.frombuffer(data, [('x', '<f4'), ('y', '<f4'), ('z', '<f4'), ('t', '<u4')])
    position, generic, float32, uint32 = 0, 4, 9, 6
    attributes = [bytes([position, float32, 1, 0, i]) for i in range(3)] + [bytes([generic, uint32, 1, 0, 3])]
    sequential = b'DRACO\2\3\0\0\0\0' + len(records).to_bytes(4, 'little') + b'\1\4' + b''.join(attributes) + bytes(4)
    return sequential + b''.join(records[name].tobytes() for name in 'xyzt')


def write_compressed(path, name, clouds, t, compress):
    """Writes a bag of CompressedPointCloud2 with the format `name`. t: uint32 [n]."""
    kind = 'point_cloud_interfaces/msg/CompressedPointCloud2'
    store = store_with(False, [(kind, 'std_msgs/Header header\nuint32 height\nuint32 width\nsensor_msgs/PointField[] fields\n'
                                      'bool is_bigendian\nuint32 point_step\nuint32 row_step\nuint8[] compressed_data\n'
                                      'bool is_dense\nstring format\n')])
    field = store.types['sensor_msgs/msg/PointField']
    fields = [field('x', 0, 7, 1), field('y', 4, 7, 1), field('z', 8, 7, 1), field('t', 12, 6, 1)]

    def message_of(frame, cloud):
        data = np.concatenate([np.float32(cloud).view(np.uint8).reshape(-1, 12), t[:, None].view(np.uint8)], 1).tobytes()
        content = np.frombuffer(compress(data), np.uint8)
        return store.types[kind](header(store, frame, False), 1, len(cloud), fields, False, 16, len(data), content, True, name)

    return write_messages(path, False, store, '/points/compressed', kind,
                          [message_of(frame, cloud) for frame, cloud in enumerate(clouds)])


def transform(store, parent, child, translation, rotation, ros1):
    """Returns a geometry_msgs/TransformStamped."""
    make = {name: store.types[f'geometry_msgs/msg/{name}'] for name in ('Vector3', 'Quaternion', 'Transform', 'TransformStamped')}
    start = header(store, 0, ros1)
    start.frame_id = parent
    return make['TransformStamped'](start, child, make['Transform'](make['Vector3'](*translation), make['Quaternion'](*rotation)))


def write_bag(folder, kind, topics, stamped=True, other=True, times=None, tf=()):
    """Writes a bag and returns its path. topics: name -> clouds of packed(). other: add a topic of strings.

    times: frame -> times of its points, float64 [n], behind 16 bytes of records of 24.
    tf: (topic, parent, child, translation, rotation), a message each.
    """
    ros1, of_tf = kind == 'ros1', 'tf2_msgs/msg/TFMessage'
    store = store_with(ros1, [(of_tf, 'geometry_msgs/TransformStamped[] transforms')])
    path = folder / (f'{kind.replace(" ", "_")}.bag' if ros1 else kind.replace(' ', '_'))
    plugin = StoragePlugin.MCAP if 'mcap' in kind else StoragePlugin.SQLITE3
    serialize = store.serialize_ros1 if ros1 else store.serialize_cdr
    with writer_of(path, ros1, plugin) as writer:
        if other:
            text = 'std_msgs/msg/String'
            connection = writer.add_connection('/chatter', text, typestore=store)
            writer.write(connection, START * 10**9, serialize(store.types[text]('hello'), text))
        connections = {topic: writer.add_connection(topic, of_tf, typestore=store) for topic in {topic for topic, *_ in tf}}
        for topic, *edge in tf:
            writer.write(connections[topic], START * 10**9, serialize(store.types[of_tf]([transform(store, *edge, ros1)]), of_tf))
        for topic, clouds in topics.items():
            connection = writer.add_connection(topic, CLOUD, typestore=store)
            for frame, cloud in enumerate(clouds):
                if times is not None:
                    cloud.fields.append(SimpleNamespace(name='time', offset=16, datatype=8, count=1))
                    cloud.data.reshape(-1, 24)[:, 16:] = np.float64(times(frame))[:, None].view(np.uint8)
                seconds, nano = stamp(frame)
                writer.write(connection, seconds * 10**9 + nano + 5000000,
                             serialize(message(store, cloud, frame, ros1, stamped), CLOUD))
    if kind.startswith('lone'):
        inside, = [file for file in path.iterdir() if file.suffix in ('.mcap', '.db3')]
        lone = folder / f'alone{inside.suffix}'
        inside.rename(lone)
        return lone
    return path
