"""revisit.recordings: data in the format of each data set is read back bit for bit."""

import bz2
import contextlib
import importlib.util
import json
import os
import sqlite3
import struct
import tempfile
import unittest
import zlib
from collections import Counter
from pathlib import Path
from random import Random
from types import SimpleNamespace
from unittest import mock

import numpy as np

import revisit
from bags import CLOUD, HAVE_ROSBAGS, KINDS, START, draco_of, message, packed, placed, write_bag, write_compressed, write_livox
from revisit import datasets
from revisit.recordings import bags as reader
from revisit.recordings import livox, open_recording, packets
from revisit.recordings.point_cloud2 import points_of

T0 = 1560000000000000000


def have(name):
    try:
        return importlib.util.find_spec(name) is not None
    except ModuleNotFoundError:
        return False


def packers():
    """Yields compressions of bags: name, compression function, decompressor."""
    yield 'bz2', bz2.compress, bz2.BZ2Decompressor
    if have('lz4.frame'):
        from lz4 import frame
        yield 'lz4', lambda data: frame.compress(data, content_checksum=True), frame.LZ4FrameDecompressor
    with contextlib.suppress(ImportError):
        from rosbags.rosbag2.reader import zstd
        checked = {zstd.CompressionParameter.checksum_flag: 1}
        yield 'zstd', lambda data: zstd.compress(data, options=checked), zstd.ZstdDecompressor


def some_points(seed, n=200):
    return np.random.default_rng(seed).uniform(-20, 20, (n, 3)).astype(np.float32)


class Folders(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = Path(folder.name)

    def put(self, name, content):
        file = self.folder / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_bytes(content if isinstance(content, bytes) else content.encode())
        return file

    def check(self, points, times=None, path=None, atol=0, **options):
        recording = open_recording(path or self.folder, **options)
        scans = list(recording.scans())
        self.assertEqual(len(scans), len(points))
        self.assertEqual(recording.count, len(points))
        for scan, expected in zip(scans, points):
            read = scan.points()
            self.assertEqual(read.dtype, np.float32)
            np.testing.assert_allclose(read[:, :3], expected, rtol=0, atol=atol)
        if times is not None:
            np.testing.assert_allclose([scan.time for scan in scans], times, rtol=0, atol=1e-6)
        return scans


def random_message(random):
    """Fields, types or offsets may be wrong, or bytes missing."""
    seldom = lambda usual, *others: random.choice(others) if random.random() < 0.06 else usual
    kind, gap = random.choice((7, 7, 8)), random.choice((0, 0, 1, 4))
    size = 4 if kind == 7 else 8
    places = [random.randrange(5) + i * (size + gap) for i in (0, 1, 2)]
    names = random.sample('xyz', 3) if random.random() < 0.3 else list('xyz')
    fields = [SimpleNamespace(name=seldom(name, 'x', 'intensity'), offset=seldom(offset, 0, 40, 2**32 - 1),
                              datatype=seldom(kind, 7, 8, 5, 0), count=seldom(1, 0, 2))
              for name, offset in zip(names, places)]
    step = seldom(max(places) + size + random.randrange(4), 0, 3, 12)
    height, width = seldom(random.choice((1, 1, 2, 3)), 0, 2**32 - 1), seldom(random.randrange(6), 2**32 - 1)
    row = seldom(width * step + random.choice((0, 0, 5)), 0, 2**32 - 1)
    bytes_there = min(height * row, 2000) - seldom(0, 1, 30)
    return SimpleNamespace(height=height, width=width, fields=fields, is_bigendian=random.random() < 0.3, point_step=step,
                           row_step=row, data=np.frombuffer(random.randbytes(max(bytes_there, 0)), np.uint8))


def unpacked(cloud):
    """Returns its points, read value by value; None for an invalid message."""
    if cloud.width * cloud.height == 0:
        return []
    order, fields = '>' if cloud.is_bigendian else '<', {field.name: field for field in cloud.fields}
    axes = [fields.get(axis) for axis in 'xyz']
    if any(not axis or axis.datatype not in (7, 8) or axis.count > 1 for axis in axes):
        return None
    reads = [(struct.Struct(order + 'fd'[axis.datatype - 7]), axis.offset) for axis in axes]
    if any(offset + number.size > cloud.point_step for number, offset in reads):
        return None
    packed_row, step = cloud.width * cloud.point_step, cloud.row_step
    fits = cloud.height == 1 or (step >= packed_row and (cloud.height - 1) * step + packed_row <= len(cloud.data))
    if not fits and len(cloud.data) == cloud.height * packed_row:
        step = packed_row
    if (cloud.height > 1 and step < packed_row) or (cloud.height - 1) * step + packed_row > len(cloud.data):
        return None
    return [[number.unpack_from(cloud.data, row * step + column * cloud.point_step + offset)[0] for number, offset in reads]
            for row in range(cloud.height) for column in range(cloud.width)]


class PointCloud2(unittest.TestCase):
    points = some_points(1)

    def test_any_layout_is_read(self):
        layouts = {
            'packed': {}, 'padded points': {'step': 32}, 'odd offsets': {'offsets': (3, 7, 11), 'step': 22},
            'apart': {'offsets': (0, 8, 16), 'step': 24}, 'out of order': {'offsets': (8, 0, 4)},
            'double': {'offsets': (0, 8, 16), 'step': 26, 'types': 'ddd'}, 'mixed': {'offsets': (0, 4, 12), 'types': 'fdf'},
            'big-endian': {'order': '>'}, 'organised': {'height': 10}, 'padded rows': {'height': 10, 'pad': 5},
            'big-endian doubles in padded rows': {'offsets': (0, 8, 16), 'step': 24, 'types': 'ddd', 'order': '>',
                                                  'height': 20, 'pad': 3}}
        for name, layout in layouts.items():
            read, _ = points_of(packed(self.points, **layout))
            self.assertEqual(read.dtype, np.float32)
            np.testing.assert_array_equal(read, self.points, name)

    def test_points_are_views_if_possible(self):
        for layout in ({}, {'step': 22}, {'height': 10}):
            cloud = packed(self.points, **layout)
            self.assertTrue(np.shares_memory(points_of(cloud)[0], cloud.data), layout)

    def test_nan_stays(self):
        holes = self.points.copy()
        holes[::3] = np.nan
        np.testing.assert_array_equal(points_of(packed(holes, height=4))[0], holes)
        self.assertEqual(points_of(packed(self.points[:0]))[0].shape, (0, 3))

    def test_times_of_points(self):
        values = np.arange(len(self.points))
        for name, code, number in (('t', 6, '<u4'), ('time', 7, '<f4'), ('time_stamp', 8, '<f8'), ('offset_time', 5, '<i4')):
            cloud = packed(self.points, step=24, height=10, pad=4)
            cloud.fields.append(SimpleNamespace(name=name, offset=16, datatype=code, count=1))
            rows = cloud.data.reshape(10, -1)
            np.ndarray((10, len(values) // 10), number, rows, 16, (rows.strides[0], 24))[:] = values.reshape(10, -1)
            points, times = points_of(cloud)
            np.testing.assert_array_equal(points, self.points)
            self.assertEqual(times.field, name)
            np.testing.assert_array_equal(times.values, values)
        cloud.fields[-1].offset = 22  # ends outside of the point
        self.assertIsNone(points_of(cloud)[1])
        self.assertIsNone(points_of(packed(self.points))[1])

    def test_seconds_and_nanoseconds_are_one_time(self):
        cloud = packed(self.points, step=24)
        cloud.fields += [SimpleNamespace(name=f'timestamp{unit}', offset=offset, datatype=6, count=1)
                         for unit, offset in (('Sec', 16), ('Nsec', 20))]
        cloud.data.reshape(-1, 24)[:, 16:].view('<u4')[:] = START, 250
        np.testing.assert_array_equal(points_of(cloud)[1].values, [START * 10**9 + 250] * len(self.points))
        del cloud.fields[-1]
        self.assertIsNone(points_of(cloud)[1])

    def test_the_size_may_determine_the_rows(self):
        for height, row in ((10, 0), (10, 7), (10, 2**32 - 1), (1, 0), (1, 5)):
            cloud = packed(self.points, height=height)
            cloud.row_step = row
            np.testing.assert_array_equal(points_of(cloud)[0], self.points)

    def test_invalid_messages_are_rejected(self):
        def wrong(says, **change):
            cloud = packed(self.points, height=2)
            for name, value in change.items():
                setattr(cloud, name, value)
            with self.assertRaisesRegex(revisit.InputError, says):
                points_of(cloud)
        twice = packed(self.points)
        twice.fields.append(SimpleNamespace(name='x', offset=4, datatype=7, count=1))
        np.testing.assert_array_equal(points_of(twice)[0], self.points)
        wrong('expected a field z', fields=packed(self.points).fields[:2])
        wrong('field y: .* found int32', fields=packed(self.points, types='fif').fields)
        wrong('ends at byte 12, beyond point_step 10', point_step=10)
        wrong('found 3100 bytes', data=packed(self.points).data[:3100])
        wrong('rows of 5', row_step=5, data=packed(self.points, pad=1, height=2).data)

    def test_random_messages_are_read_as_by_struct(self):
        random, outcomes = Random(1), Counter()
        for case in range(4000):
            cloud = random_message(random)
            expected = unpacked(cloud)
            with self.subTest(case=case, cloud=cloud), np.errstate(all='ignore'):
                try:
                    read, _ = points_of(cloud)
                except revisit.InputError:
                    read = None
                self.assertEqual(read is None, expected is None)
                if read is not None:
                    self.assertEqual((read.dtype, read.shape), (np.float32, (len(expected), 3)))
                    np.testing.assert_array_equal(read, np.array(expected).astype(np.float32).reshape(-1, 3))
            outcomes['refused' if expected is None else 'read' if expected else 'empty'] += 1
        self.assertGreater(min(outcomes.values()), 300, outcomes)


@unittest.skipUnless(HAVE_ROSBAGS, 'without the package rosbags: pip install rosbags')
class Bags(Folders):
    clouds = [some_points(seed) for seed in range(4)]

    def test_points_come_back_bit_for_bit(self):
        for kind in KINDS:
            with self.subTest(kind), tempfile.TemporaryDirectory() as folder:
                path = write_bag(Path(folder), kind, {'/points': [packed(cloud, step=22) for cloud in self.clouds]})
                scans = self.check(self.clouds, [START + 0.1 * i for i in range(4)], path)
                self.assertEqual([scan.frame for scan in scans], [0, 1, 2, 3])
                for scan, cloud in zip(scans, self.clouds):
                    self.assertEqual(scan.points().tobytes(), cloud.tobytes())

    def test_livox_messages(self):
        tags = {0: True, 0b01: False, 0b0100: False, 0b10: True, 0b110000: True}
        for ros1 in (True, False):
            for package in livox.PACKAGES:
                path = write_livox(self.folder, ros1, package, self.clouds, [*tags] * 40)
                recording = open_recording(path)
                self.assertEqual(recording.point_times, 'field offset_time, ns of the clock of the stamps')
                for scan, cloud in zip(recording.scans(), self.clouds):
                    points, times = scan.read()
                    normal = np.array([*tags.values()] * 40)
                    np.testing.assert_array_equal(points[normal], cloud[normal])
                    self.assertTrue(np.isnan(points[~normal]).all())
                    np.testing.assert_allclose(times, np.arange(200) * 5e-4, atol=1e-6)
        point = SimpleNamespace(x=1, y=2, z=3, tag=0, offset_time=5)
        points, times = livox.points_of_custom(SimpleNamespace(point_num=1, timebase=2**64 - 9, points=[point]))
        self.assertEqual((points.tolist(), times.values.tolist()), ([[1, 2, 3]], [2**64 - 4]))

    def test_compressed_clouds(self):
        from rosbags.rosbag2.reader import zstd
        formats = {'zlib': zlib.compress, 'zstd': zstd.compress, 'draco': draco_of if have('DracoPy') else None}
        t = (np.arange(200) * 500000).astype(np.uint32)
        for name, compress in formats.items():
            path = self.folder / name
            if compress is None:
                path = write_compressed(path, name, self.clouds, t, lambda data: data)
                with self.assertRaisesRegex(revisit.Error, 'pip install DracoPy'):
                    list(open_recording(path).scans())[0].read()
                continue
            recording = open_recording(write_compressed(path, name, self.clouds, t, compress))
            self.assertEqual(recording.point_times, 'field t, ns')
            for scan, cloud in zip(recording.scans(), self.clouds):
                points, times = scan.read()
                np.testing.assert_array_equal(points, cloud)
                np.testing.assert_allclose(times, t * 1e-9, atol=1e-6)
        for name, compress, says in (('lzma', bytes, 'expected draco, zlib or zstd'), ('zstd', lambda data: b'x' * 200, 'as zstd'),
                                     ('zlib', lambda data: b'', 'decompression bomb'), ('zlib', lambda data: zlib.compress(data[:9]), '9 bytes')):
            [scan, *_] = open_recording(write_compressed(self.folder / f'bad_{name}_{says[:2]}', name, self.clouds, t, compress)).scans()
            with self.assertRaisesRegex(revisit.InputError, says):
                scan.read()

    def test_point_times_have_one_convention(self):
        after = np.arange(200) * 5e-4
        path = write_bag(self.folder, 'mcap', {'/points': [packed(cloud, step=24) for cloud in self.clouds]},
                         times=lambda frame: after / after[-1] if frame else np.full(200, frame))
        recording = open_recording(path)
        self.assertEqual(recording.point_times, 'field time, 0 to 1 of a scan of 100 ms')
        self.assertIsNone(next(recording.scans()).read()[1])
        times = [scan.read()[1] for scan in recording.scans()][1:]
        np.testing.assert_allclose(times, [after / after[-1] * 0.1] * 3, atol=1e-6)
        for unit, last in (('s', 1), ('none', None)):
            times = [scan.read()[1] for scan in open_recording(path, point_times=unit).scans()][1]
            self.assertEqual(times is None or times[-1], True if last is None else last)
        with self.assertRaisesRegex(revisit.UsageError, 'expected auto, s, ms'):
            open_recording(path, point_times='minutes')

    def test_without_a_stamp_the_time_of_recording_counts(self):
        path = write_bag(self.folder, 'ros1', {'/points': [packed(cloud) for cloud in self.clouds]}, stamped=False)
        self.check(self.clouds, [START + 0.1 * i + 0.005 for i in range(4)], path)

    def test_split_recordings_are_one(self):
        for part in range(2):
            (self.folder / f'{part}').mkdir()
            path = write_bag(self.folder / f'{part}', 'ros1', {'/points': [packed(cloud) for cloud in self.clouds]})
            path.rename(self.folder / f'part_{part}.bag')
        self.assertEqual(len(list(open_recording(self.folder).scans())), 8)

    def test_a_topic_is_chosen(self):
        path = write_bag(self.folder, 'mcap', {'/a': [packed(self.clouds[0])], '/b': [packed(self.clouds[1])] * 2})
        with self.assertRaisesRegex(revisit.UsageError, 'choose one of /a, /b with --sequence, or merge some with --topics /a,/b'):
            open_recording(path)
        self.check([self.clouds[1]] * 2, path=path, sequence='/b')
        with self.assertRaisesRegex(revisit.UsageError, 'no topic /c'):
            open_recording(path, sequence='/c')

    def test_sensors_on_one_topic_are_separated(self):
        clouds = [placed(packed(cloud), name) for cloud, name in zip(self.clouds, ('front', '/rear') * 2)]
        for kind in ('ros1', 'mcap'):
            with self.subTest(kind), tempfile.TemporaryDirectory() as folder:
                path = write_bag(Path(folder), kind, {'/points': clouds})
                with self.assertRaisesRegex(revisit.UsageError, r'/points has scans of several sensors .*choose one of /points@front, '
                                            '/points@rear with --sequence, or merge some with --topics /points@front,/points@rear'):
                    open_recording(path)
                scans = list(open_recording(path, sequence='/points@rear').scans())
                self.assertEqual([scan.frame for scan in scans], [0, 1])
                for scan, cloud in zip(scans, self.clouds[1::2]):
                    np.testing.assert_array_equal(scan.points(), cloud)
                with self.assertRaisesRegex(revisit.UsageError, 'no scans of the frame_id left .found front, rear'):
                    open_recording(path, sequence='/points@left')
                with mock.patch.object(reader, 'EXAMINED', 0), self.assertRaisesRegex(revisit.InputError, 'frame 1: /points has scans of sev'):
                    list(open_recording(path).scans())

    def test_sensors_are_merged(self):
        """The rear one looks back, 2 m behind the front one, and scans 30 ms later."""
        back = self.clouds[1:] + self.clouds[:1]
        topics = {'/front': [placed(packed(cloud), 'front') for cloud in self.clouds],
                  '/rear': [placed(packed(cloud), 'rear', 0.03) for cloud in back]}
        level, turned = (0, 0, 0, 1), (0, 0, 1, 0)
        fixed = [('/tf_static', 'base', 'front', (1, 0, 0.5), level), ('/tf', '/deck', '/rear', (0, 0, 0.5), turned),
                 ('/tf_static', 'base', 'deck', (-1, 0, 0), level), ('/tf', 'odom', 'base', (3, 0, 0), level),
                 ('/tf', 'odom', 'base', (4, 0, 0), level)]
        moving = [*fixed, ('/tf', 'deck', 'rear', (0, 0.1, 0.5), turned)]
        file = self.put('poses.txt', '# of the robot\n/front 1 0 0.5 0 0 0 1\nrear, -1, 0, 0.5, 0, 0, 2, 0\n')
        expected = [np.concatenate([here, there * np.float32([-1, -1, 1]) - np.float32([2, 0, 0])])
                    for here, there in zip(self.clouds, back)]
        for kind in ('ros1', 'mcap'):
            with tempfile.TemporaryDirectory() as folder:
                by_tree, other = Path(folder) / 'tree', Path(folder) / 'other'
                by_tree.mkdir(), other.mkdir()
                bag = write_bag(by_tree, kind, topics, tf=fixed)
                moved = write_bag(other, kind, topics, tf=moving)
                for path, options in ((bag, {}), (bag, {'extrinsics': file}), (moved, {'extrinsics': file})):
                    with self.subTest(kind, options=options):
                        scans = self.check(expected, [START + 0.1 * i for i in range(4)], path, 1e-5, topics='/front,/rear', **options)
                        np.testing.assert_allclose(scans[2].read()[1], np.repeat([0, 0.03], 200), atol=1e-6)
                with self.assertRaisesRegex(revisit.UsageError, 'TF does not relate the frame_id rear of /rear to front; give'):
                    open_recording(moved, topics='/front,/rear')
        alone = write_bag(self.folder, 'mcap', topics)
        for text, says in (('/front 1 0 0 0 0 0 1\n', 'no line for /rear .frame_id rear.; it has front'),
                           ('/front 1 0 0 0 0 0\n', 'poses.txt:1: expected a topic or frame_id'),
                           ('/front 1 0 0 0 0 0 0\n', 'poses.txt:1: expected'), ('front a b c d e f g\n', 'poses.txt:1: expected')):
            with self.subTest(text), self.assertRaisesRegex(revisit.Error, says):
                open_recording(alone, topics='/front,/rear', extrinsics=self.put('poses.txt', text))
        file = self.put('poses.txt', '\ufefffront 1 0 0.5 0 0 0 1\n/rear -1 0 0.5 0 0 2 0\n')
        self.check(expected, path=alone, atol=1e-5, topics='/front, /rear', extrinsics=file)
        for topics in ('/front,/front', '/front,/front@front', ','):
            with self.subTest(topics), self.assertRaises(revisit.UsageError):
                open_recording(alone, topics=topics, extrinsics=file)
        with self.assertRaisesRegex(revisit.InputError, 'poses.txt:3: a second pose of /rear'):
            open_recording(alone, topics='/front,/rear', extrinsics=self.put('poses.txt', file.read_text() + '/rear 0 0 0 0 0 0 1\n'))

    def test_merged_sensors_may_scan_at_other_rates(self):
        def merged(late, clouds, **more):
            with tempfile.TemporaryDirectory() as folder:
                path = write_bag(Path(folder), 'mcap', {'/a': [placed(packed(cloud, **more), 'a') for cloud in self.clouds],
                                                        '/b': [placed(packed(cloud), 'b', late) for cloud in clouds]})
                return [scan.read() for scan in open_recording(path, topics=['/a', '/b'], extrinsics=self.put(
                    'poses', 'a 0 0 0 0 0 0 1\nb 0 0 0 0 0 0 1\n')).scans()]
        seldom = write_bag(self.folder, 'sqlite3', {'/a': [placed(packed(cloud), 'a') for cloud in self.clouds],
                                                    '/b': [placed(packed(self.clouds[0]), 'b')]})
        file = self.put('poses', 'a 0 0 0 0 0 0 1\nb 0 0 0 0 0 0 1\n')
        self.assertRegex(open_recording(seldom, topics='/a,/b', extrinsics=file).warnings[0], '/b has 1 scans, /a 4')
        self.assertEqual(open_recording(seldom, topics='/b,/a', extrinsics=file).warnings, [])
        zeros = self.clouds[3].copy()
        zeros[::2] = 0
        read = merged(0, [self.clouds[0], zeros])
        self.assertEqual([len(points) for points, _ in read], [400, 300, 200, 200])
        self.assertEqual([times for _, times in read], [None] * 4)
        self.assertEqual([len(points) for points, _ in merged(0.06, self.clouds)], [200, 400, 400, 600])
        with self.assertRaisesRegex(revisit.InputError, 'no scan of /b is within 0.1 s of one of /a; .* Synchronize the clocks'):
            merged(0.7, self.clouds)
        after = np.linspace(0, 0.09, 200)
        path = write_bag(self.folder, 'mcap', {name: [placed(packed(cloud, step=24), name, late) for cloud in self.clouds]
                                               for name, late in (('/a', 0), ('/b', 0.02))}, times=lambda frame: START + frame / 10 + after)
        merged_bag = open_recording(path, topics='/a,/b', extrinsics=self.put('poses', 'a 0 0 0 0 0 0 1\nb 0 0 0 0 0 0 1\n'))
        for scan in merged_bag.scans():  # both have clock times, so those of /b are before its stamps
            np.testing.assert_allclose(scan.read()[1], [*after, *after], atol=1e-6)
        self.assertRegex(merged_bag.point_times, '^/a: .*; /b: ')
        for options in ({'topics': '/a', 'sequence': '/a'}, {'extrinsics': 'x'}):
            with self.assertRaises(revisit.UsageError):
                open_recording(self.folder, **options)

    def test_odd_clouds_are_read_as_they_are(self):
        """Half of the points are NaN, zero, infinite or far away; stamps jump back in the middle."""
        for value in (np.nan, 0, np.inf, 1e9):
            clouds = [cloud.copy() for cloud in self.clouds]
            for cloud in clouds:
                cloud[::2] = value
            clouds = [*clouds[:2], *clouds]
            packs = [placed(packed(cloud), 'lidar', -0.2 if i > 2 else 0) for i, cloud in enumerate(clouds)]
            with self.subTest(value), tempfile.TemporaryDirectory() as folder:
                path = write_bag(Path(folder), 'mcap', {'/points': packs})
                self.check(clouds, [START + 0.1 * i - 0.2 * (i > 2) for i in range(6)], path)

    def test_a_recorder_that_was_killed(self):
        path = write_bag(self.folder, 'mcap', {'/points': [packed(cloud) for cloud in self.clouds]})
        file, = path.glob('*.mcap')
        file.write_bytes(file.read_bytes()[:-2000])
        (path / 'metadata.yaml').unlink()
        with self.assertRaisesRegex(revisit.InputError, 'cannot be read as a bag: .*`mcap recover` may repair it'):
            open_recording(path)

    def test_lost_messages_are_missed(self):
        path = write_bag(self.folder, 'sqlite3', {'/points': [packed(cloud) for cloud in self.clouds]})
        file, = path.glob('*.db3')
        with contextlib.closing(sqlite3.connect(file)) as base:
            base.execute('DELETE FROM messages WHERE id = (SELECT max(id) FROM messages)')
            base.commit()
        scans = open_recording(path).scans()
        for _ in range(3):
            next(scans).points()
        with self.assertRaisesRegex(revisit.InputError, 'expected 4 messages .*, found 3'):
            next(scans)

    def test_decompression_bombs_are_rejected(self):
        from rosbags.rosbag1 import Writer
        from rosbags.typesys import Stores, get_typestore
        store, text = get_typestore(Stores.ROS1_NOETIC), 'std_msgs/msg/String'
        for kind in ('BZ2', 'LZ4'):
            path = self.folder / f'{kind}.bag'
            writer = Writer(path)
            writer.set_compression(Writer.CompressionFormat[kind])
            with writer:
                clouds = writer.add_connection('/points', CLOUD, typestore=store)
                writer.write(clouds, START * 10**9, store.serialize_ros1(message(store, packed(self.clouds[0]), 0, True), CLOUD))
                others = writer.add_connection('/others', text, typestore=store)
                writer.write(others, START * 10**9, bytes(300 << 20))
            self.assertLess(path.stat().st_size, 3 << 20)
            with self.assertRaisesRegex(revisit.InputError, f'{kind}.bag: .* expand to more than 256 MB'):
                list(open_recording(path).scans())

    def test_compressed_data_may_be_large_or_of_several_streams(self):
        few = np.random.default_rng(1).bytes(50_000)
        for name, pack, make in packers():
            with self.subTest(name):
                unpack = reader.bounded(name, make)
                self.assertEqual(unpack(pack(few) + pack(b'more')), few + b'more')
                self.assertEqual(unpack(pack(b'')), b'')
                for n in range(1, 10):
                    self.assertEqual(unpack(pack(few) + bytes(n)), few)
                with mock.patch.object(reader, 'MAX_UNPACKED', 1000):
                    self.assertEqual(unpack(pack(few), len(few)), few)
                    with self.assertRaisesRegex(ValueError, 'decompression bomb'):
                        unpack(pack(bytes(1 << 23)))
                for packed in (b'', pack(few)[:-1], pack(b'more') + pack(few)[:-1]):
                    with self.assertRaisesRegex(ValueError, 'are truncated'):
                        unpack(packed)
                damaged = bytearray(pack(b'more') + pack(few))
                damaged[-20_000] ^= 1
                with self.assertRaises(Exception):  # each decompressor has its own type
                    unpack(damaged)

    def test_many_packed_streams_are_linear_work(self):
        pieces = []

        class Counting:
            def __init__(self):
                self.own = bz2.BZ2Decompressor()

            def decompress(self, piece, most):
                pieces.append(len(piece))
                return self.own.decompress(piece, most)

            def __getattr__(self, name):
                return getattr(self.own, name)
        self.assertEqual(reader.bounded('bz2', Counting)(bz2.compress(b'') * 5000), b'')
        self.assertEqual(len(pieces), 5000)
        self.assertLessEqual(max(pieces), reader.PIECE)

    def test_compressed_files_are_bounded(self):
        try:
            from rosbags.rosbag2.enums import CompressionFormat, CompressionMode
        except ImportError:
            self.skipTest('an old rosbags')
        from rosbags.rosbag2 import StoragePlugin, Writer
        from rosbags.typesys import Stores, get_typestore
        store = get_typestore(Stores.LATEST)
        for mode in ('MESSAGE', 'STORAGE', 'FILE'):
            path = self.folder / mode
            writer = Writer(path, version=9, storage_plugin=StoragePlugin.SQLITE3 if mode == 'MESSAGE' else StoragePlugin.MCAP)
            writer.set_compression(CompressionMode[mode], CompressionFormat.ZSTD)
            with writer:
                clouds = writer.add_connection('/points', CLOUD, typestore=store)
                writer.write(clouds, START * 10**9, store.serialize_cdr(message(store, packed(self.clouds[0]), 0, False), CLOUD))
                writer.write(clouds, START * 10**9 + 1, bytes(300 << 20))
            with self.assertRaisesRegex(revisit.InputError, f'{mode}: .* expand to more than .* bomb'):
                list(open_recording(path).scans())

    def test_impossible_values_are_one_scan(self):
        path = write_bag(self.folder, 'mcap', {'/points': [packed(cloud) for cloud in self.clouds]})
        with mock.patch.dict(reader.READS, {CLOUD: lambda message: np.int64(2**64)}):
            for scan in open_recording(path).scans():
                with self.assertRaisesRegex(revisit.InputError, 'mcap: cannot be read as a bag: Python int'):
                    scan.points()

    def test_a_pipe_instead_of_a_file_is_rejected(self):
        path = write_bag(self.folder, 'mcap', {'/points': [packed(self.clouds[0])]})
        file, = path.glob('*.mcap')
        file.unlink()
        os.mkfifo(file)
        with self.assertRaisesRegex(revisit.InputError, 'mcap: not a regular file'):
            open_recording(path)

    def test_a_broken_message_is_one_scan(self):
        cut = packed(self.clouds[1])
        cut.data = cut.data[:100]
        path = write_bag(self.folder, 'mcap', {'/a': [packed(self.clouds[0]), cut, packed(self.clouds[2])]})
        first, broken, last = open_recording(path).scans()
        with self.assertRaisesRegex(revisit.InputError, 'found 100 bytes'):
            broken.points()
        np.testing.assert_array_equal(last.points(), self.clouds[2])


class Layouts(Folders):
    """Two or three small scans in the documented format of each data set."""
    points = [some_points(seed, 50) for seed in range(3)]

    def with_columns(self, points, *more):
        return np.concatenate([points, *[np.full((len(points), 1), value, np.float32) for value in more]], 1)

    def test_kitti(self):
        for i, points in enumerate(self.points):
            self.put(f'sequences/03/velodyne/{i:06}.bin', self.with_columns(points, 0.5).tobytes())
        self.put('sequences/03/times.txt', '0.0\n0.1\n0.2\n')
        self.put('sequences/03/calib.txt', 'P0: ' + '1 ' * 12 + '\nTr: 0 -1 0 0.1 0 0 -1 0.2 1 0 0 0.3\n')
        self.put('poses/03.txt', ''.join(f'1 0 0 0 0 1 0 0 0 0 1 {z}\n' for z in (0, 1, 2)))
        scans = self.check(self.points, [0, 0.1, 0.2], sequence='03')
        np.testing.assert_allclose(scans[2].pose, [[0, -1, 0, 0.1], [0, 0, -1, 0.2], [1, 0, 0, 2.3], [0, 0, 0, 1]])

    def test_plain_folders(self):
        for i, points in enumerate(self.points):
            datasets.write_kitti_scan(self.folder / f'{i}.bin', points)
        self.check(self.points)

    def test_ply_and_pcd(self):
        for i, points in enumerate(self.points):
            header = f'ply\nformat binary_little_endian 1.0\nelement vertex {len(points)}\nproperty float x\nproperty float y\n' \
                     'property float z\nend_header\n'
            self.put(f'ply/{i}.ply', header.encode() + points.tobytes())
            header = f'VERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH {len(points)}\nHEIGHT 1\n' \
                     f'POINTS {len(points)}\nDATA binary\n'
            self.put(f'pcd/{i}.pcd', header.encode() + points.tobytes())
        for kind in ('ply', 'pcd'):
            self.check(self.points, path=self.folder / kind)

    def test_times_of_npy(self):
        clock = np.float64([1.7e9, 1.7e9 + 0.0625])
        seconds = [0, 0.0625]
        for name, field, other in (('t', clock, None), ('timestamp', clock.astype('datetime64[s]'), None), ('time', ['a', 'b'], None),
                                   ('t', ['0.1', '0.2'], clock), ('t', np.zeros((2, 2)), clock), ('t', seconds, 's')):
            field = np.asarray(field)
            rows = [(axis, '<f4') for axis in 'xyz'] + [(name, field.dtype, field.shape[1:])]
            rows += [] if other is None else [('s', '<f4')] if isinstance(other, str) else [('time', '<f8')]
            array = np.zeros(2, rows)
            array[name], array['x'] = field, 1
            if other is clock:
                array['time'] = clock
            np.save(self.folder / '1.npy', array)
            (scan,) = open_recording(self.folder).scans()
            times = scan.read()[1]
            if field is clock or other is clock:
                self.assertEqual(list(times), seconds)
            else:
                self.assertIsNone(times, array.dtype)

    def test_npy(self):
        structured = np.zeros(50, [('x', 'f8'), ('i', 'u1'), ('y', 'f8'), ('z', 'f8'), ('t', 'u4')])
        for axis, column in zip('xyz', self.points[2].T):
            structured[axis] = column
        structured['t'] = np.arange(50) * 10**6
        for name, array in (('9', self.points[0]), ('10', self.with_columns(self.points[1], 1).astype(np.float64)), ('11', structured)):
            np.save(self.folder / f'{name}.npy', array)
        scans = self.check(self.points)
        self.assertIsNone(scans[0].read()[1])
        np.testing.assert_allclose(scans[2].read()[1], np.arange(50) * 1e-3, atol=1e-6)
        np.save(self.folder / '12.npy', np.zeros((5, 2)))
        with (self.folder / '13.npy').open('wb') as file:
            np.savez(file, self.points[0])
        header = b"{'descr': (".ljust(117) + b'\n'  # truncated
        self.put('14.npy', b'\x93NUMPY\1\0' + struct.pack('<H', 118) + header)
        np.save(self.folder / '15.npy', self.points[0][:, :3].T)
        scans = list(open_recording(self.folder).scans())
        for scan, says in zip(scans[3:], (r'12.npy: expected .* found float64 of shape \(5, 2\)', '13.npy: .* an archive',
                                          '14.npy: cannot be read', '15.npy: .* a column for each point'), strict=True):
            with self.assertRaisesRegex(revisit.InputError, says):
                scan.points()

    def test_kitti_360(self):
        drive = '2013_05_28_drive_0003_sync'
        for i, points in enumerate(self.points):
            self.put(f'data_3d_raw/{drive}/velodyne_points/data/{i:010}.bin', self.with_columns(points, 0.5).tobytes())
        self.put(f'data_3d_raw/{drive}/velodyne_points/timestamps.txt',
                 ''.join(f'2013-05-28 08:46:02.{i}00000000\n' for i in range(3)))
        self.put(f'data_poses/{drive}/poses.txt', '1 1 0 0 5 0 1 0 6 0 0 1 7\n')
        self.put('calibration/calib_cam_to_pose.txt', 'image_00: 0 0 1 1 1 0 0 2 0 1 0 3\nimage_01: ' + '0 ' * 12 + '\n')
        self.put('calibration/calib_cam_to_velo.txt', '0 0 1 0.5 -1 0 0 0.25 0 -1 0 0\n')
        for path, options in ((self.folder, {'sequence': '3'}), (self.folder / 'data_3d_raw' / drive, {})):
            scans = self.check(self.points, [1369730762 + 0.1 * i for i in range(3)], path, **options)
            self.assertIsNone(scans[0].pose)
            self.assertEqual(open_recording(path, **options).name, drive)
            # IMU: x forward, y right, z down. The camera is at 1, 2, 3 of the IMU and 0.5, 0.25, 0 of the Velodyne.
            # The position 5 + 0.5, 6 + 2 + 0.25, 7 + 3 has the world's axes.
            np.testing.assert_allclose(scans[1].pose[:3, 3], [5.5, 8.25, 10])
        self.addCleanup(os.chdir, os.getcwd())
        for inside, path in (('velodyne_points', '..'), ('.', '.')):
            os.chdir(self.folder / 'data_3d_raw' / drive / inside)
            recording = open_recording(path)
            self.assertEqual(recording.name, drive)
            self.assertIsNotNone(list(recording.scans())[1].pose)
        self.put(f'data_3d_raw/{drive}/velodyne_points/timestamps.txt', b'\xff\xfe2')
        with self.assertRaisesRegex(revisit.InputError, 'timestamps.txt:1: expected a date'):
            open_recording(self.folder)
        self.put(f'data_poses/{drive}/poses.txt', '1 2 0 0 5 0 1 0 6 0 0 1 7\n')
        with self.assertRaisesRegex(revisit.InputError, 'poses.txt: expected a rigid transform'):
            open_recording(self.folder)

    def write_mulran(self, folder='Ouster'):
        for i, points in enumerate(self.points):
            self.put(f'{folder}/{T0 + i * 10**8}.bin', self.with_columns(points, 100).tobytes())

    def test_mulran(self):
        self.write_mulran()
        self.put('global_pose.csv', ''.join(
            f'{T0 + i * 11 * 10**7},1,0,0,{353000 + i},0,1,0,4026000,0,0,1,20\n' for i in range(2)))
        scans = self.check(self.points, [T0 / 1e9 + 0.1 * i for i in range(3)])
        # The lidar is 1.7042 m ahead, 0.021 m right and 1.8047 m above the base, rotated by 179.6654 degrees.
        np.testing.assert_allclose(scans[1].pose[:3, 3], [353001 + 1.7042, 4026000 - 0.021, 20 + 1.8047], atol=1e-4)
        np.testing.assert_allclose(scans[1].pose[0, 0], np.cos(np.radians(179.6654)), atol=1e-6)
        self.assertIsNotNone(scans[2].pose)  # 0.09 s from the last one
        self.put('global_pose.csv', f'{T0 + 10**7},1,0,0,0,0,1,0,0,0,0,1,0\n')
        recording = open_recording(self.folder)
        self.assertEqual([scan.pose is None for scan in recording.scans()], [False, False, True])
        self.assertIn('1 of 3 scans have no pose', recording.warnings[0])
        self.put('global_pose.csv', f'{T0},1,0,0,0,0,1,0,0,0,0,1,0\n{T0 + 10**8},0,0,0,0,0,0,0,0,0,0,0,0\n')
        with self.assertRaisesRegex(revisit.InputError, f'global_pose.csv: .* at time {T0 + 10**8}'):
            open_recording(self.folder)
        # Rows without a scan are ignored.
        self.put('global_pose.csv', f'{T0 - 10**10},0,0,0,0,0,0,0,0,0,0,0,0\n{T0},1,0,0,0,0,1,0,0,0,0,1,0\n')
        self.assertIsNotNone(next(open_recording(self.folder).scans()).pose)

    def test_names_that_are_no_numbers(self):
        for name in ('1566279795.718219613.bin', '\u00b2.bin'):
            self.put(f'k360/velodyne_points/data/{name}', bytes(16))
        with self.assertRaisesRegex(revisit.InputError, 'expected files NUMBER.bin'):
            open_recording(self.folder / 'k360')

    def test_helipr(self):
        layouts = {'Ouster': ('<ffffIHHH', (1.5, 0, 8, 9, 10), (0, 10**6, 0, 0, 0)),
                   'Velodyne': ('<ffffHf', (1.5, 3, 0), (0, 0, 1e-3)), 'Avia': ('<fffBBBI', (1, 2, 3, 0), (0, 0, 0, 10**6)),
                   'Aeva': ('<fffffiBf', (0.5, -2.0, 0, 6, 0.7), (0, 0, 10**6, 0, 0))}
        for sensor, (form, rest, steps) in layouts.items():
            for i, points in enumerate(self.points):
                self.put(f'LiDAR/{sensor}/{1691936557946849180 + i * 10**8}.bin',
                         b''.join(struct.pack(form, *point, *(value + n * step for value, step in zip(rest, steps)))
                                  for n, point in enumerate(points.tolist())))
        self.put('LiDAR_GT/global_Ouster_gt.txt', f'{1691936557946849180 + 10**8} 1 2 3 0 0 0.7071068 0.7071068\n')
        times = [1691936557.946849180 + 0.1 * i for i in range(3)]
        for sensor in layouts:
            scans = self.check(self.points, times, sequence=sensor)
            self.assertEqual(scans[1].pose is not None, sensor == 'Ouster')
            np.testing.assert_allclose(scans[1].read()[1], np.arange(50) * 1e-3, atol=1e-6, err_msg=sensor)
        scans = self.check(self.points, times, sequence='Ouster')
        np.testing.assert_allclose(scans[1].pose[:3, 3], [1, 2, 3])
        np.testing.assert_allclose(scans[1].pose[:3, 0], [0, 1, 0], atol=1e-6)  # facing left
        with self.assertRaisesRegex(revisit.UsageError, '--sequence: Ouster, Velodyne, Avia, Aeva'):
            open_recording(self.folder)
        truth = self.put('LiDAR_GT/Aeva_gt.txt', f'{1691936557946849180} 1 2 3 0 0 0 0\n')
        with self.assertRaisesRegex(revisit.InputError, 'Aeva_gt.txt: .* at time 1691936557946849'):
            open_recording(self.folder, sequence='Aeva')
        truth.unlink()
        old = b''.join(struct.pack('<fffffiB', *point, 0.5, -2.0, 5, 6) for point in self.points[0].tolist())
        self.put('LiDAR/Aeva/1691936557946849179.bin', old)
        self.check([self.points[0], *self.points], sequence='Aeva')

    def test_nclt(self):
        day = self.folder / '2012-01-08'
        stored = [np.random.default_rng(i).integers(0, 65536, (50, 3), np.uint16) for i in range(3)]
        for i, integers in enumerate(stored):
            self.put(f'{day.name}/velodyne_sync/{1326030975000000 + i * 200000}.bin',
                     b''.join(struct.pack('<HHHBB', *point, 50, 3) for point in integers.tolist()))
        self.put('ground_truth/groundtruth_2012-01-08.csv', ''.join(
            f'{1326030975000000 + i * 200000},{i},2,3,0,0,{np.pi / 2}\n' for i in range(3)))
        meters = [(integers * 0.005 - 100.0) * [1, -1, -1] for integers in stored]
        scans = self.check(meters, [1326030975 + 0.2 * i for i in range(3)], day, atol=4e-5)
        # NCLT's world has x north, y east, z down.
        np.testing.assert_allclose(scans[1].pose[:3, 3], [1, -2, -3])
        np.testing.assert_allclose(scans[1].pose[:3, 0], [0, -1, 0], atol=1e-6)
        truth = self.folder / 'ground_truth/groundtruth_2012-01-08.csv'
        truth.write_text(f'1326030974900000,{"nan," * 5}nan\n' + truth.read_text())  # like the first row of its files
        np.testing.assert_array_equal([scan.pose for scan in open_recording(day).scans()], [scan.pose for scan in scans])
        truth.write_text(f'1326030974900000,{"nan," * 5}nan\n')
        with self.assertRaisesRegex(revisit.InputError, 'is empty'):
            open_recording(day)

    def test_nuscenes(self):
        name = 'n015-2018-07-24-11-22-45+0800__LIDAR_TOP__{}.pcd.bin'
        stamps = [1532402927647951 + 50000 * i for i in range(3)]
        files = [f'{"samples" if i == 0 else "sweeps"}/LIDAR_TOP/{name.format(stamp)}' for i, stamp in enumerate(stamps)]
        for file, points in zip(files, self.points):
            self.put(file, self.with_columns(points, 12, 3).tobytes())
        times = [stamp / 1e6 for stamp in stamps]
        self.assertIsNone(self.check(self.points, times)[0].pose)
        self.check(self.points[1:], times[1:], self.folder / 'sweeps/LIDAR_TOP')
        tables = {
            'scene': [{'token': 's', 'name': 'scene-0061'}, {'token': 't', 'name': 'scene-0103'}],
            'sample': [{'token': 'a', 'scene_token': 's'}, {'token': 'b', 'scene_token': 't'}],
            'calibrated_sensor': [{'token': 'c', 'translation': [1, 0, 1.8], 'rotation': [0.7071068, 0, 0, -0.7071068]}],
            'ego_pose': [{'token': f'e{i}', 'translation': [10 + i, 20, 0], 'rotation': [1, 0, 0, 0]} for i in range(3)],
            'sample_data': [{'token': f'd{i}', 'sample_token': 'a', 'ego_pose_token': f'e{i}', 'calibrated_sensor_token': 'c',
                             'timestamp': stamps[i], 'filename': files[i]} for i in (2, 0, 1)]
            + [{'sample_token': 'a', 'filename': 'samples/CAM_FRONT/x.jpg'}, {'sample_token': 'b', 'filename': files[0]}]}
        for table, rows in tables.items():
            self.put(f'v1.0-mini/{table}.json', json.dumps(rows))
        for sequence in ('61', 'scene-0061'):
            scans = self.check(self.points, times, sequence=sequence)
            np.testing.assert_allclose(scans[2].pose[:3, 3], [13, 20, 1.8])
            np.testing.assert_allclose(scans[2].pose[:3, 1], [1, 0, 0], atol=1e-6)  # its y is forward
        with self.assertRaisesRegex(revisit.UsageError, 'scene-0061, scene-0103'):
            open_recording(self.folder)
        tables['ego_pose'][1]['rotation'] = [0, 0, 0, 0]
        self.put('v1.0-mini/ego_pose.json', json.dumps(tables['ego_pose']))
        with self.assertRaisesRegex(revisit.InputError, 'v1.0-mini: expected tables of nuScenes: .* expected a rigid'):
            open_recording(self.folder, sequence='61')

    def test_untrusted_tables(self):
        """Tables of nuScenes must not name files outside of the data set, and must not be nested too deeply."""
        self.put('outside/LIDAR_TOP/1.pcd.bin', self.with_columns(self.points[0], 12, 3).tobytes())
        row = {'token': 'd', 'sample_token': 'a', 'ego_pose_token': 'e', 'calibrated_sensor_token': 'c', 'timestamp': 1}
        at = {'translation': [0, 0, 0], 'rotation': [1, 0, 0, 0]}
        tables = {'scene': [{'token': 's', 'name': 'scene-0061'}], 'sample': [{'token': 'a', 'scene_token': 's'}],
                  'calibrated_sensor': [{'token': 'c', **at}], 'ego_pose': [{'token': 'e', **at}]}
        for table, rows in tables.items():
            self.put(f'set/v1.0-mini/{table}.json', json.dumps(rows))
        for name in ('../outside/LIDAR_TOP/1.pcd.bin', f'{self.folder}/outside/LIDAR_TOP/1.pcd.bin'):
            self.put('set/v1.0-mini/sample_data.json', json.dumps([row | {'filename': name}]))
            with self.assertRaisesRegex(revisit.InputError, 'expected the name of a file of the data set'):
                open_recording(self.folder / 'set')
        for name, says in (('\0', 'no such file'), ('\ud800', 'no such file'), ('y' * 5000, 'too long')):
            self.put('set/v1.0-mini/sample_data.json', json.dumps([row | {'filename': f'x/LIDAR_TOP/{name}'}]))
            [scan] = open_recording(self.folder / 'set').scans()
            with self.assertRaisesRegex(revisit.InputError, says):
                scan.points()
        for wrong in ({'filename': 7}, {'timestamp': 'x'}, {'sample_token': ['a']}):
            self.put('set/v1.0-mini/sample_data.json', json.dumps([row | {'filename': 'x/LIDAR_TOP/y'} | wrong]))
            with self.assertRaisesRegex(revisit.InputError, 'expected tables of nuScenes'):
                open_recording(self.folder / 'set')
        self.put('set/v1.0-mini/sample_data.json', json.dumps([row | {'filename': 'x/LIDAR_TOP/y', 'timestamp': 10**400}]))
        with self.assertRaisesRegex(revisit.InputError, 'v1.0-mini: expected tables of nuScenes: OverflowError'):
            open_recording(self.folder / 'set')
        self.put('set/v1.0-mini/scene.json', '[' * 100000)
        with self.assertRaisesRegex(revisit.InputError, 'scene.json: .*recursion'):
            open_recording(self.folder / 'set')

    def test_a_pipe_instead_of_a_scan_is_rejected(self):
        self.write_mulran()
        self.put('arrays/1.npy', '')
        for folder, name in ((self.folder, f'Ouster/{T0}.bin'), (self.folder / 'arrays', '1.npy')):
            (folder / name).unlink()
            os.mkfifo(folder / name)
            scan = next(open_recording(folder).scans())
            with self.assertRaisesRegex(revisit.InputError, f'{name}: not a regular file'):
                scan.points()

    def test_a_file_cut_off_is_one_scan(self):
        self.write_mulran()
        file = sorted((self.folder / 'Ouster').iterdir())[1]
        file.write_bytes(file.read_bytes()[:-3])
        scans = list(open_recording(self.folder).scans())
        with self.assertRaisesRegex(revisit.InputError, 'points of 16 bytes each, found 797 bytes'):
            scans[1].points()
        np.testing.assert_array_equal(scans[2].points(), self.points[2])

    def test_unknown_formats_are_rejected(self):
        with self.assertRaisesRegex(revisit.InputError, 'no such file'):
            open_recording(self.folder / 'nowhere')
        with self.assertRaisesRegex(revisit.InputError, 'unknown format'):
            open_recording(self.put('notes.txt', 'hello'))
        with self.assertRaisesRegex(revisit.InputError, 'no scans here'):
            open_recording(self.folder)
        self.put('scans/1.bin', self.points[0].tobytes())
        self.put('scans/1.npy', 'notes')
        self.put('arrays/1.npy', 'notes')
        with self.assertRaisesRegex(revisit.UsageError, 'sequence /p: not supported for npy data'):
            open_recording(self.folder / 'arrays', sequence='/p')


class Packets(Folders):
    def write_vlp16(self, meters=10.0):
        """Returns two revolutions of a VLP-16 within a wall at 10 m: 24-byte pcap header, then Ethernet, IPv4 and UDP with 1206 bytes."""
        out = [struct.pack('<IHHiIII', 0xa1b2c3d4, 2, 4, 0, 0, 65535, 1)]
        azimuth = 0
        for packet in range(160):
            payload = b''
            for _ in range(12):
                payload += struct.pack('<HH', 0xeeff, azimuth) + struct.pack('<HB', int(meters / 0.002), 50) * 32
                azimuth = (azimuth + 40) % 36000
            time = packet * 1327
            payload += struct.pack('<IBB', time, 0x37, 0x22)
            udp = struct.pack('>HHHH', 2368, 2368, 8 + len(payload), 0) + payload
            ip = struct.pack('>BBHHHBBH4s4s', 0x45, 0, 20 + len(udp), 0, 0, 64, 17, 0, b'\0' * 4, b'\xff' * 4) + udp
            frame = b'\0' * 12 + b'\x08\0' + ip
            out.append(struct.pack('<IIII', START + time // 10**6, time % 10**6, len(frame), len(frame)) + frame)
        return self.put('drive.pcap', b''.join(out))

    def test_velodyne(self):
        path = self.write_vlp16()
        if not have('velodyne_decoder'):
            with self.assertRaisesRegex(revisit.Error, 'pip install velodyne-decoder'):
                open_recording(path)
            self.skipTest('without the package velodyne-decoder')
        scans = list(open_recording(path).scans())
        self.assertGreaterEqual(len(scans), 2)
        self.assertLess(abs(scans[1].time - START), 1)
        self.assertLess(scans[0].time, scans[1].time)
        middle = scans[1].points()
        self.assertGreater(len(middle), 20000)
        np.testing.assert_allclose(np.linalg.norm(middle[:, :3], axis=1), 10, atol=0.1)
        self.assertAlmostEqual(np.ptp(scans[1].read()[1]), 0.1, delta=0.02)
        with self.assertRaisesRegex(revisit.InputError, 'packets'):
            open_recording(self.put('empty.pcap', b'not a pcap'))

    def test_metadata_tell_an_ouster(self):
        path = self.put('drive_1.pcap', b'')
        self.put('drive_1.json', '{"notes": 1}')
        self.assertIsNone(packets.metadata_of(path))
        for name in ('drive_2.json', 'drive_1_meta.json', 'other.json'):
            self.put(name, '{"beam_altitude_angles": []}')
        self.assertEqual(packets.metadata_of(path).name, 'drive_1_meta.json')

    def test_ouster(self):
        if not have('ouster.sdk.osf'):
            with self.assertRaisesRegex(revisit.Error, 'pip install ouster-sdk'):
                open_recording(self.put('drive.osf', b''))
            self.skipTest('without the package ouster-sdk')
        from ouster.sdk import core, osf
        info = core.SensorInfo.from_default(core.LidarMode._1024x10)
        path = self.folder / 'drive.osf'
        with osf.Writer(str(path), info) as writer:
            for i in range(2):
                frame = core.LidarFrame(info)
                frame.field(core.ChanField.RANGE)[:, 10:] = 10000
                frame.status[:], frame.timestamp[:] = 1, 10**9 * (START + i) + np.arange(1024) * 10**5
                frame.frame_id = i
                writer.save(0, frame)
        scans = list(open_recording(path).scans())
        self.assertEqual([scan.time for scan in scans], [START, START + 1])
        points = scans[1].points()
        self.assertEqual(points.shape, (64 * 1014, 3))
        np.testing.assert_allclose(np.linalg.norm(points, axis=1), 10, atol=0.1)
        np.testing.assert_allclose(np.unique(scans[1].read()[1]), np.arange(10, 1024) * 1e-4, atol=1e-6)


if __name__ == '__main__':
    unittest.main()
