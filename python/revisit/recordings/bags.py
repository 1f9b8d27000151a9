"""Reader of ROS 1 bags, ROS 2 bags and MCAP files, by the package rosbags, without ROS."""

import contextlib
import functools
import heapq
import os
import re
import struct
import sys
import types
from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np

from revisit.errors import Error, InputError, UsageError
from revisit.poses import rigid
from revisit.recordings import compressed, livox
from revisit.recordings.merging import merged, poses_by_file, poses_by_tree
from revisit.recordings.point_cloud2 import fields_of, points_of
from revisit.recordings.recording import Recording, Scan, package, with_point_times

ENDINGS = ('.bag', '.db3', '.mcap')
CLOUD = 'sensor_msgs/msg/PointCloud2'
REPAIRED_BY = {'index': 'rosbag reindex', 'end magic': 'mcap recover', 'malformed': 'sqlite3 FILE .recover'}
READS = {CLOUD: points_of, compressed.COMPRESSED: lambda message: points_of(compressed.decompressed(message)),
         **{f'{name}/msg/CustomMsg': livox.points_of_custom for name in livox.PACKAGES}}
"""Types of messages with points."""
TF = 'tf2_msgs/msg/TFMessage'
TFS = (TF, 'tf/msg/tfMessage')
EXAMINED = 20
"""Messages whose frame_ids are known before the first scan is read."""
CLOUDS = (*READS, *(name.replace('/msg/', '/') for name in READS))

MAX_UNPACKED = 1 << 28
"""Decompressed size [bytes] that is always allowed; chunks have about a megabyte, clouds tens."""
MAX_RATIO = 100
"""Allowed compression ratio beyond that. Scans have ratios of a few, zeros of a million."""
MAGIC = {'bz2': rb'BZh', 'lz4': rb'(\x04"|[P-_]\*)M\x18', 'zstd': rb'\(\xb5/\xfd|[P-_]\*M\x18'}
"""Magic numbers of streams, including skippable frames of LZ4 and Zstandard."""
PIECE = 1 << 14
"""Input per call of a decompressor [bytes], because unused input is copied."""


def max_unpacked(size):
    return max(MAX_UNPACKED, MAX_RATIO * size)


def bounded(kind, make):
    """Returns a decompression function limited to max_unpacked().

    make: creates a decompressor, one per stream. Data after the first stream is decompressed if it has the magic number.
    """
    begins = re.compile(MAGIC[kind])

    def unpack(data, *_):
        parts, at = [], 0
        limit = left = max_unpacked(len(data))
        while at == 0 or begins.match(data, at):
            unpacker = make()
            while not unpacker.eof:
                piece = bytes(data[at:at + PIECE]) if unpacker.needs_input else b''
                if unpacker.needs_input and not piece:
                    raise ValueError(f'{len(data)} compressed bytes are truncated')
                at += len(piece)
                parts.append(unpacker.decompress(piece, left + 1))
                left -= len(parts[-1])
                if left < 0:
                    raise ValueError(f'{len(data)} compressed bytes expand to more than {limit >> 20} MB (decompression bomb)')
            at -= len(unpacker.unused_data or b'')
        return b''.join(parts)
    return unpack


def bounded_open(zstd):
    def open_(packed, mode):
        size = os.fstat(packed.fileno()).st_size
        file = zstd.open(packed, mode)
        read = file.read

        def checked(n=-1):
            part = read(n)
            if file.tell() > max_unpacked(size):
                raise ValueError(f'{size} compressed bytes expand to more than {max_unpacked(size) >> 20} MB (decompression bomb)')
            return part
        file.read = checked
        return file
    return open_


@functools.cache
def bound_unpacking():
    """Replaces the package's decompression functions, which have no limit. Other versions may lack these tables."""
    import bz2

    import lz4.frame
    ours = {'bz2': bounded('bz2', bz2.BZ2Decompressor), 'lz4': bounded('lz4', lz4.frame.LZ4FrameDecompressor)}
    of_ros2 = sys.modules.get('rosbags.rosbag2.reader')
    zstd = getattr(of_ros2, 'zstd', None)
    if hasattr(zstd, 'ZstdDecompressor') and hasattr(zstd, 'open'):
        ours['zstd'] = bounded('zstd', zstd.ZstdDecompressor)
        of_ros2.zstd = types.SimpleNamespace(**vars(zstd) | {'open': bounded_open(zstd), 'decompress': ours['zstd']})
    for module, name in (('rosbag1.reader', 'decompressors'), ('rosbag2.storage_mcap', 'DECOMPRESSORS')):
        table = getattr(sys.modules.get(f'rosbags.{module}'), name, {})
        table.update({key: unpack for key, unpack in ours.items() if key in table})


def detects(path):
    return path.suffix in ENDINGS if path.is_file() else bool(files_of(path))


def files_of(path):
    """Returns the folder of a ROS 2 bag, or files: a ROS 1 recording may be split into several."""
    if path.is_file() or (path / 'metadata.yaml').is_file():
        return [path]
    return next((files for ending in ENDINGS if (files := sorted(path.glob(f'*{ending}')))), [])


@contextlib.contextmanager
def errors_of(path):
    """Converts the package's exceptions for corrupted files to InputError."""
    try:
        yield
    except Error:
        raise
    except Exception as error:  # corrupted bytes raise many types
        text = str(error) or type(error).__name__
        advice = next((f'; `{program}` may repair it' for word, program in REPAIRED_BY.items() if word in text), '')
        raise InputError(f'{path}: cannot be read as a bag: {text}{advice}') from error


@contextlib.contextmanager
def opened(path):
    package('rosbags', 'rosbags', f'{path}: reading bags')
    from rosbags.rosbag1 import Reader as Reader1
    from rosbags.rosbag2 import Reader as Reader2
    bound_unpacking()
    files = files_of(path)
    for file in [*files, *(path.iterdir() if path.is_dir() else ())]:
        if not (file.is_file() or file.is_dir()) and file.suffix in (*ENDINGS, '.zstd'):
            raise InputError(f'{file}: not a regular file')  # reading a pipe would not end
    ending = files[0].suffix
    if files[0].is_file() and ending != '.bag' and ending not in getattr(Reader2, 'STORAGE_PLUGINS', {}):
        raise Error(f'{path}: a {ending} file without the metadata.yaml of its bag needs a newer rosbags: '
                    'pip install -U rosbags (in another environment than ouster-sdk, which requires an old one)')
    with contextlib.ExitStack() as stack:
        yield [stack.enter_context((Reader1 if file.suffix == '.bag' else Reader2)(file)) for file in files]


class Topic(NamedTuple):
    """Scans of one sensor in a bag."""
    name: str
    frame_id: str
    count: int | None
    """Number of scans, or None if the topic has other frame_ids, too."""
    scans: Callable[[], Iterator[Scan]]


def choose(path, readers, topic):
    """Returns the requested topic ('': none), or the only one of clouds."""
    connections = [connection for reader in readers for connection in reader.connections]
    clouds = [connection for connection in connections if connection.msgtype in CLOUDS]
    topics = sorted({connection.topic for connection in clouds})
    if topic and topic not in topics:
        raise UsageError(f'{path}: no topic {topic} of clouds (found {", ".join(topics) or "none"})')
    if not topics:
        others = ', '.join(sorted({f'{c.topic} ({c.msgtype})' for c in connections})) or 'none'
        raise InputError(f'{path}: no topic of PointCloud2, CompressedPointCloud2 or Livox\'s CustomMsg; topics: {others}')
    if not topic:
        topics = [name for name in topics if any(c.topic == name and c.msgcount != 0 for c in clouds)] or topics
        if len(topics) > 1:
            raise UsageError(f'{path}: several topics of clouds; {advice(topics)}')
    return topic or topics[0]


def advice(names):
    return f'choose one of {", ".join(names)} with --sequence, or merge some with --topics {",".join(names)}'


def connections_of(reader, topic, types=CLOUDS):
    return [c for c in reader.connections if topic in ('', c.topic) and c.msgtype in types]


def is_ros1(connection):
    ext = connection.ext
    return type(ext).__name__ == 'ConnectionExtRosbag1' or getattr(ext, 'serialization_format', '') == 'ros1'


def messages(path, topic, types=CLOUDS):
    """Yields (receive time [s], is ROS 1, type, bytes), ordered by time over all files. topic '': any of the types."""
    with errors_of(path), opened(path) as readers:
        of = [reader.messages(connections=found) for reader in readers if (found := connections_of(reader, topic, types))]
        for connection, nanoseconds, data in heapq.merge(*of, key=lambda message: message[1]):
            yield nanoseconds * 1e-9, is_ros1(connection), connection.msgtype, data


@functools.cache
def store_of(ros1):
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore
    store = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.LATEST)
    for name, definition in (livox.DEFINITIONS | compressed.DEFINITIONS | {TF: 'geometry_msgs/TransformStamped[] transforms'}).items():
        store.register(get_types_from_msg(definition, name))
    return store


def type_of(kind):
    """Returns the name of a type in ROS 2's form, of Livox's message that of one package."""
    name = TF if kind in TFS else kind if '/msg/' in kind else kind.replace('/', '/msg/')
    return livox.CUSTOM if READS.get(name) is livox.points_of_custom else name


def decode(path, ros1, kind, data):
    """Returns the message, by the published definition (PointCloud2's is unchanged since 2009) instead of the bag's."""
    with errors_of(path):
        store = store_of(ros1)
        return (store.deserialize_ros1 if ros1 else store.deserialize_cdr)(data, type_of(kind))


def read(path, ros1, kind, data):
    with errors_of(path):  # one message with impossible values is one scan
        return READS[type_of(kind)](decode(path, ros1, kind, data))


def header_of(path, recorded, ros1, data):
    """Returns the time of the header [s], at the beginning of the data, or the receive time if it is 0; and the frame_id."""
    with errors_of(path):
        seconds, nano, size = struct.unpack_from('<III' if ros1 else '<iII' if data[1] & 1 else '>iII', data, 4)
        frame_id = bytes(data[16:16 + size]).rstrip(b'\0').decode('utf-8', 'replace').lstrip('/')
    return seconds + nano * 1e-9 or recorded, frame_id


def size_of(message):
    return message.point_num if hasattr(message, 'point_num') else message.width * message.height


def scans_of(path, topic, frame_id, chosen, count):
    """Yields the scans of a frame_id. Raises InputError at the first scan of another one, unless frame_id is `chosen`."""
    frame, number = -1, 0
    for number, (recorded, ros1, kind, data) in enumerate(messages(path, topic), 1):
        time, found = header_of(path, recorded, ros1, data)
        if found != frame_id:
            if chosen:
                continue
            raise InputError(f'{path}, frame {number - 1}: {several_sensors(topic, (frame_id, found))}')
        frame += 1
        yield Scan(frame, time, None, lambda ros1=ros1, kind=kind, data=data: read(path, ros1, kind, data), f'{path}, frame {frame}')
    if number < count:
        raise InputError(f"{path}: {topic}: expected {count} messages by the bag's index, found {number}; the bag is corrupted")


def several_sensors(topic, frame_ids):
    return f'{topic} has scans of several sensors (frame_id); {advice([f"{topic}@{frame_id}" for frame_id in frame_ids])}'


def open_topic(path, name) -> Topic:
    """name: TOPIC or TOPIC@FRAME_ID; '': the only one with scans."""
    topic, _, chosen = name.partition('@')
    with errors_of(path), opened(path) as readers:
        topic = choose(path, readers, topic)
        count = sum(connection.msgcount for reader in readers for connection in connections_of(reader, topic))
    frame_ids, with_points = [], None
    for i, (recorded, ros1, kind, data) in enumerate(messages(path, topic)):
        _, frame_id = header_of(path, recorded, ros1, data)
        frame_ids += [] if frame_id in frame_ids else [frame_id]
        if with_points is None and frame_id == (chosen or frame_ids[0]):
            message = decode(path, ros1, kind, data)
            with_points = message if size_of(message) else None
        if with_points is not None and i >= EXAMINED:
            break
    if chosen and chosen not in frame_ids:
        raise UsageError(f'{path}: {topic}: no scans of the frame_id {chosen} (found {", ".join(frame_ids) or "none"})')
    if not chosen and len(frame_ids) > 1:
        raise UsageError(f'{path}: {several_sensors(topic, frame_ids)}')
    if with_points is None:
        raise InputError(f'{path}: topic {topic} has no messages with points')
    try:
        if hasattr(with_points, 'fields'):
            fields_of(with_points)  # fails before any scan is described
    except InputError as error:
        raise InputError(f'{path}: {topic}: {error}') from None
    frame_id = chosen or frame_ids[0]
    return Topic(name or topic, frame_id, None if chosen else count or None,
                 lambda: scans_of(path, topic, frame_id, bool(chosen), count))


def transforms(path):
    """Returns the rigid tree of the bag's TF: frame -> (parent, T_parent_frame). Joints that move are no part of it."""
    tree, moving = {}, set()
    for _, *message in messages(path, '', TFS):
        for one in decode(path, *message).transforms:
            t, q, child = one.transform.translation, one.transform.rotation, one.child_frame_id.lstrip('/')
            parent, T = one.header.frame_id.lstrip('/'), rigid(np.array([[t.x, t.y, t.z]]), np.array([[q.x, q.y, q.z, q.w]]))[0]
            before = tree.setdefault(child, (parent, T))
            if before[0] != parent or not np.allclose(before[1], T, atol=1e-4):
                moving.add(child)
    return {child: edge for child, edge in tree.items() if child not in moving}


def open_bag(path, topic) -> Recording:
    found = open_topic(path, topic)
    return Recording(path.stem, found.count, found.scans)


def open_merged(path, names, extrinsics, unit) -> Recording:
    """Merges topics (TOPIC or TOPIC@FRAME_ID). extrinsics: file of the sensors' poses; None: the bag's TF. unit: of the point times."""
    topics = [open_topic(path, name.strip()) for name in names]
    if len({(topic.name.partition('@')[0], topic.frame_id) for topic in topics}) < len(topics):
        raise UsageError(f'{path}: topics: expected different sensors, found {", ".join(names)}')
    count = topics[0].count
    rare = [f'{topic.name} has {topic.count} scans, {names[0]} {count}: most are without it; name the slowest sensor first'
            for topic in topics if topic.count and count and 2 * topic.count < count]
    poses = poses_by_file(extrinsics, topics) if extrinsics else poses_by_tree(path, transforms(path), topics)
    timed = [with_point_times(Recording(topic.name, topic.count, topic.scans), unit) for topic in topics]
    topics = [topic._replace(scans=recording.scans) for topic, recording in zip(topics, timed)]
    return Recording(path.stem, count, lambda: merged(path, topics, poses), rare,
                     point_times='; '.join(f'{recording.name}: {recording.point_times}' for recording in timed))
