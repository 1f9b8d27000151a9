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


def message(store, cloud, frame, ros1, stamped=True):
    make = {name: store.types[f'{package}/msg/{name}'] for package, name in (
        ('builtin_interfaces', 'Time'), ('std_msgs', 'Header'), ('sensor_msgs', 'PointField'), ('sensor_msgs', 'PointCloud2'))}
    time = make['Time'](*(stamp(frame) if stamped else (0, 0)))
    header = make['Header'](**({'seq': frame} if ros1 else {}), stamp=time, frame_id='lidar')
    values = vars(cloud) | {'fields': [make['PointField'](**vars(field)) for field in cloud.fields]}
    return make['PointCloud2'](header=header, **values)


def write_bag(folder, kind, topics, stamped=True, other=True):
    """Writes a bag and returns its path. topics: name -> clouds of packed(). other: add a topic of strings."""
    from rosbags.rosbag1 import Writer as Writer1
    from rosbags.rosbag2 import Writer as Writer2
    from rosbags.typesys import Stores, get_typestore
    ros1 = kind == 'ros1'
    store = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.LATEST)
    path = folder / (f'{kind.replace(" ", "_")}.bag' if ros1 else kind.replace(' ', '_'))
    plugin = StoragePlugin.MCAP if 'mcap' in kind else StoragePlugin.SQLITE3
    serialize = store.serialize_ros1 if ros1 else store.serialize_cdr
    with Writer1(path) if ros1 else Writer2(path, version=9, storage_plugin=plugin) as writer:
        if other:
            text = 'std_msgs/msg/String'
            connection = writer.add_connection('/chatter', text, typestore=store)
            writer.write(connection, START * 10**9, serialize(store.types[text]('hello'), text))
        for topic, clouds in topics.items():
            connection = writer.add_connection(topic, CLOUD, typestore=store)
            for frame, cloud in enumerate(clouds):
                seconds, nano = stamp(frame)
                writer.write(connection, seconds * 10**9 + nano + 5000000,
                             serialize(message(store, cloud, frame, ros1, stamped), CLOUD))
    if kind.startswith('lone'):
        inside, = [file for file in path.iterdir() if file.suffix in ('.mcap', '.db3')]
        lone = folder / f'alone{inside.suffix}'
        inside.rename(lone)
        return lone
    return path
