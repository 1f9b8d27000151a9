"""Recordings in the program: `revisit loops` and others read what `python3 -m revisit.recordings` streams."""

import contextlib
import csv
import io
import json
import os
import re
import signal
import subprocess
import sys
import tempfile
import time
import unittest
from pathlib import Path
from unittest import mock

import numpy as np

import revisit
from bags import HAVE_ROSBAGS, KINDS, packed, write_bag
from folders import FolderTest, tum_line
from revisit import datasets, poses, program, recordings, show
from revisit.loops import recognize
from scans import room, simulate

PROGRAM = os.environ.get('REVISIT_PROGRAM', '')
EXAMPLE = os.environ.get('REVISIT_LOOP_CLOSURE', '')
"""Program of examples/loop_closure.cpp."""
SAME_MOMENT = ['--exclusion', 'frames=7', '--threshold', '0', '--drive', 'd', '--sensor', 'vlp16']
ENVIRONMENT = os.environ | {'REVISIT_PYTHON': sys.executable, 'PYTHONPATH': os.pathsep.join(filter(None, sys.path))}


def run(*arguments, **options):
    options = {'text': True, 'errors': 'surrogateescape', 'capture_output': True, 'env': ENVIRONMENT} | options
    done = subprocess.run([PROGRAM, *map(str, arguments)], **options)
    return done.returncode, done.stdout, done.stderr


def lines_of(text):
    return [json.loads(line) for line in text.splitlines()]


def without(found, *names):
    return [{name: value for name, value in line.items() if name not in names} for line in found]


def save_arrays(folder, scans):
    """Writes a folder of .npy files, which the Python package reads."""
    folder.mkdir(parents=True)
    for i, points in enumerate(scans):
        np.save(folder / f'{i:06}.npy', points)
    return folder


def write_helipr(folder, scans, T_world_lidar):
    """Writes scans and poses, z up, in the layout of HeLiPR's Velodyne."""
    sensor = folder / 'LiDAR' / 'Velodyne'
    sensor.mkdir(parents=True)
    (folder / 'LiDAR_GT').mkdir()
    times = [1691936557946849180 + i * 10**8 for i in range(len(scans))]
    for time_, points in zip(times, scans):
        content = np.zeros(len(points), [('xyz', '<f4', 3), ('intensity', '<f4'), ('ring', '<u2'), ('time', '<f4')])
        content['xyz'] = points
        content.tofile(sensor / f'{time_}.bin')
    (folder / 'LiDAR_GT' / 'Velodyne_gt.txt').write_text(''.join(
        f'{time_} {tum_line(0, pose).split(" ", 1)[1]}\n' for time_, pose in zip(times, T_world_lidar)))
    return folder


class Streams(FolderTest):
    """python3 -m revisit.recordings"""

    def stream(self, *arguments, code=0):
        done = subprocess.run([sys.executable, '-m', 'revisit.recordings', *map(str, arguments)], capture_output=True)
        self.assertEqual((done.returncode, done.stderr), (code, b''))
        out, parts = io.BytesIO(done.stdout), []
        for line in iter(out.readline, b''):
            content = json.loads(line)
            n = content.get('points', 0)
            points = np.frombuffer(out.read(12 * n), '<f4').reshape(-1, 3)
            parts.append((content, points, np.frombuffer(out.read(4 * n), '<f4') if content.get('times') else None))
        return parts

    def test_points_times_and_poses_arrive_bit_for_bit(self):
        scans = [np.random.default_rng(i).uniform(-20, 20, (50 + i, 3)).astype(np.float32) for i in range(3)]
        way = np.tile(np.eye(4), (3, 1, 1))
        way[:, 0, 3] = range(3)
        data = write_helipr(self.folder / 'drive', scans, way)
        (first, *_), *parts, (last, *_) = self.stream(data)
        self.assertEqual((first, last), ({'revisit_scans': 1, 'name': 'drive-Velodyne', 'count': 3, 'warnings': [],
                                          'point_times': 'none, because field time has no resolution: 1 value in a scan'},
                                         {'end': True}))
        self.assertEqual(len(parts), 3)
        for (line, points, times), scan, expected in zip(parts, scans, recordings.open_recording(data).scans()):
            np.testing.assert_array_equal(points, scan)
            self.assertEqual((line['frame'], line['time'], line['source']), (expected.frame, expected.time, expected.source))
            np.testing.assert_array_equal(np.reshape(line['pose'], (3, 4)), expected.pose[:3])
            self.assertEqual(times is None, expected.read()[1] is None)
        (first, *_), *parts, _ = self.stream(data, '--every', 2)
        self.assertEqual((first['count'], [line['frame'] for line, *_ in parts]), (2, [0, 2]))

    def test_times_of_points(self):
        points = np.zeros(50, [('x', 'f4'), ('y', 'f4'), ('z', 'f4'), ('t', 'u4')])
        points['x'], points['t'] = 1, np.arange(50) * 10**6
        _, (_, _, times), _ = self.stream(save_arrays(self.folder / 'drive', [points]))
        np.testing.assert_allclose(times, np.arange(50) * 1e-3, atol=1e-6)

    def test_a_scan_that_cannot_be_read_is_reported(self):
        data = save_arrays(self.folder / 'drive', [room(1), np.zeros((5, 2)), room(2)])
        lines = [line for line, *_ in self.stream(data)]
        self.assertEqual([line.get('points') for line in lines], [None, len(room(1)), 0, len(room(2)), None])
        self.assertRegex(lines[2]['error'], r'^.*000001\.npy: expected a floating-point array')

    def test_errors_are_in_the_stream(self):
        for data, more, code, message in ((self.folder / 'nowhere', [], 3, 'no such file'),
                                          (save_arrays(self.folder / 'drive', [room(1)]), ['--sequence', '/p'], 2, 'sequence /p: not supported')):
            (line, *_), = self.stream(data, *more, code=code)
            self.assertEqual(line['code'], code)
            self.assertIn(message, line['error'])

    def test_the_reader_of_the_stream_may_exit(self):
        data = save_arrays(self.folder / 'drive', [room(i) for i in range(5)])
        process = subprocess.Popen([sys.executable, '-m', 'revisit.recordings', data], stdout=subprocess.PIPE, stderr=subprocess.PIPE)
        process.stdout.read(10)
        process.stdout.close()
        self.assertEqual(process.stderr.read(), b'')
        process.stderr.close()
        self.assertEqual(process.wait(), 1)


@unittest.skipUnless(os.access(PROGRAM, os.X_OK), 'without the program: REVISIT_PROGRAM names none')
class Command(FolderTest):
    def loops(self, *arguments, code=0, **options):
        left, out, err = run('loops', *arguments, '--format', 'jsonl', **options)
        self.assertEqual(left, code, err)
        return lines_of(out)

    def fails(self, code, message, *arguments, **options):
        left, out, err = run('loops', *arguments, **options)
        self.assertEqual((left, out), (code, ''), err)
        self.assertEqual(err.count('\n'), 1, err)
        self.assertRegex(err, f'^revisit: .*{message}')


class Drives(Command):
    """A simulated drive of a VLP-16 with revisits."""

    @classmethod
    def setUpClass(cls):
        folder = tempfile.TemporaryDirectory()
        cls.addClassCleanup(folder.cleanup)
        cls.town = Path(folder.name) / 'town'
        simulate(cls.town, length=300, sensor='vlp16', every=20, route='both')
        drive = datasets.open_dataset(cls.town, poses=True).scans
        cls.scans = [datasets.read_scan(ref.file)[:, :3] for ref in drive]
        cls.camera = np.array([ref.pose for ref in drive])
        cls.lidar = poses.AXES_OF_CAMERA.T @ cls.camera @ poses.read_extrinsic(cls.town / 'sequences/00/calib.txt')
        cls.plain = Path(folder.name) / 'plain'
        cls.plain.mkdir()
        for i, points in enumerate(cls.scans):
            datasets.write_kitti_scan(cls.plain / f'{i:06}.bin', points)
        cls.arrays = save_arrays(Path(folder.name) / 'arrays', cls.scans)
        cls.helipr = write_helipr(Path(folder.name) / 'helipr', cls.scans, cls.lidar)
        cls.found = lines_of(run('loops', cls.plain, *SAME_MOMENT, '--format', 'jsonl')[1])

    def check_same(self, found):
        self.assertEqual(without(found, 'time', 'match_time', 'file'), without(self.found, 'file'))

    def test_recordings_have_the_same_loops(self):
        found = self.loops(self.arrays, *SAME_MOMENT)
        self.check_same(found)
        self.assertEqual(found[0]['file'], str(self.arrays / f'{found[0]["frame"]:06}.npy'))
        with subprocess.Popen([sys.executable, '-m', 'revisit.recordings', self.arrays], stdout=subprocess.PIPE) as stream:
            self.check_same(self.loops('-', *SAME_MOMENT, stdin=stream.stdout))
        self.check_same(without(self.loops(self.helipr, *SAME_MOMENT, '--odometry-gate', 'none'), 'pose', 'position', 'match_position'))

    @unittest.skipUnless(HAVE_ROSBAGS, 'without the package rosbags: pip install rosbags')
    def test_bags_have_the_same_loops(self):
        for kind in KINDS[:3]:
            with self.subTest(kind):
                path = write_bag(self.folder, kind, {'/points': [packed(points) for points in self.scans]})
                found = self.loops(path, *SAME_MOMENT)
                self.check_same(found)
                self.assertTrue(found[0]['file'].startswith(str(path)))

    def test_loops_are_registered(self):
        self.assertGreater(len(self.found), 3)
        for line in self.found:
            registered = line['registered']
            self.assertTrue(line['accepted'] and registered['fits'])
            self.assertGreater(line['frame'], line['match_frame'] + 7)
            truth = np.linalg.inv(self.camera[line['match_frame']]) @ self.camera[line['frame']]
            # KITTI's camera has z forward and x right, and an offset from the lidar.
            self.assertLess(np.hypot(registered['x'] - truth[2, 3], registered['y'] + truth[0, 3]), 0.8)
        rows = list(csv.DictReader(io.StringIO(run('loops', self.arrays, *SAME_MOMENT)[1])))
        self.assertEqual([(int(row['frame']), row['registered']) for row in rows], [(line['frame'], '1') for line in self.found])

    def test_other_commands_read_recordings(self):
        file = self.folder / 'a.map'
        for data in (self.arrays, self.plain):
            code, _, err = run('map', 'build', data, '--map', file, '--sensor', 'vlp16', '--warmup', 12, '-q')
            self.assertEqual(code, 0, err)
        map_ = revisit.maps.MapStore.open(file)
        self.assertEqual(len(map_), 2 * len(self.scans))
        code, out, err = run('locate', file, self.arrays, '--format', 'jsonl')
        self.assertEqual((code, len({line['frame'] for line in lines_of(out)})), (0, len(self.scans)), err)
        figures = []
        for data in (self.helipr, self.town):
            code, _, err = run('eval', data, '--feature', 'ring', '--sensor', 'vlp16', '--exclusion', 'meters=60', '-q',
                               '-o', self.folder / data.name)
            self.assertEqual(code, 0, err)
            [result] = (self.folder / data.name).rglob('run.json')
            figures.append([task['metrics']['average_precision'] for task in json.loads(result.read_text())['tasks']])
        np.testing.assert_allclose(*figures, atol=0.1)  # poses of the lidar, and of the camera beside it
        code, _, err = run('eval', self.arrays, '--feature', 'ring', '--sensor', 'vlp16', '-q', '-o', self.folder)
        self.assertEqual(code, 3)
        self.assertIn(f'{len(self.scans)} of {len(self.scans)} scans have no pose; give a drive that has poses', err)
        pairs = self.folder / 'pairs.csv'
        pairs.write_text(''.join(f'{line["frame"]},{line["match_frame"]}\n' for line in self.found))
        code, _, err = run('eval', self.arrays, '--sensor', 'vlp16', '--exclusion', 'frames=7', '--pairs', f'{pairs},near=1', '-q',
                           '-o', self.folder)
        self.assertEqual(code, 0, err)
        self.assertIn('made of scan files, not of recordings', err)

    @unittest.skipUnless(os.access(EXAMPLE, os.X_OK), 'without the program of examples/loop_closure.cpp')
    def test_three_interfaces_find_the_same_edges(self):
        town = self.folder / 'hdl64'
        simulate(town, length=400, every=12, route='both')
        files = [scan.file for scan in datasets.open_dataset(town).scans]
        plain = self.folder / 'plain64'
        plain.mkdir()
        for i, file in enumerate(files):
            (plain / f'{i:06}.bin').symlink_to(file)
        by_program = [(line['frame'], line['match_frame'], round(line['score'], 3), line['registered']['x'], line['registered']['y'])
                      for line in self.loops(plain, '--sensor', 'hdl64')]
        self.assertGreater(len(by_program), 5)
        detector = revisit.LoopDetector(revisit.open_map(None, 'hdl64'))
        by_python = [(visit.scan.frame, visit.found.loop.frame, round(visit.found.loop.score, 3), *visit.found.registered.T_place_query[:2, 3])
                     for visit in recognize(recordings.open_recording(plain).scans(), detector) if visit.found.accepted]
        np.testing.assert_allclose(by_python, by_program, atol=2e-3)
        out = subprocess.run([EXAMPLE, self.folder / 'a.map', *sorted(plain.iterdir())], text=True, capture_output=True, check=True).stdout
        edges = re.findall(r'(\d+).bin matches entry (\d+), score ([\d.]+), .*\n +(-?[\d.]+) m ahead of it, (-?[\d.]+) m', out)
        ids = {place.id: place.frame for place in revisit.maps.MapStore.open(self.folder / 'a.map').entries()}
        by_cpp = [(int(frame), ids[int(place)], float(score), float(x), float(y)) for frame, place, score, x, y in edges]
        np.testing.assert_allclose(by_cpp, by_program, atol=6e-3)

    def test_poses_are_the_same_in_every_form(self):
        calib = self.town / 'sequences/00/calib.txt'
        given = {'camera': (self.camera, ['--calib', calib]), 'lidar': (self.lidar, [])}
        far = ['--exclusion', 'meters=60', *SAME_MOMENT[2:]]
        own = self.loops(self.town, *far)
        self.assertGreater(len(own), 5)
        apart = [np.hypot(*(line['position'][axis] - line['match_position'][axis] for axis in 'xz')) for line in own]
        self.assertLess(np.median(apart), 5)
        for frame, (matrices, more) in given.items():
            file = self.folder / 'poses.txt'
            np.savetxt(file, matrices[:, :3].reshape(-1, 12), fmt='%.12g')
            found = self.loops(self.arrays, *far, '--poses', file, '--pose-frame', frame, *more)
            self.assertEqual(len(found), len(own))
            for one, other in zip(own, found):
                self.assertEqual(one['match_frame'], 20 * other['match_frame'])
                at = matrices[other['frame'], :3, 3] if frame == 'lidar' else list(one['position'].values())
                np.testing.assert_allclose(list(other['position'].values()), at, atol=1e-5)
        for scale in 1, 1000, 0:  # meters, millimeters, odometry that stands still or equal stamps
            np.savetxt(file, (self.lidar[:, :3] * [1, 1, 1, scale]).reshape(-1, 12), fmt='%.12g')
            messages = run('loops', self.arrays, *far, '--poses', file, '--pose-frame', 'lidar')[2]
            self.assertEqual('expected meters, and scans with stamps that increase' in messages, scale != 1, messages)
        file.write_text('0 0 0 0 0 0 0 1\n')
        self.fails(3, 'the scans have none', self.arrays, '--poses', file, '--pose-frame', 'lidar')
        file.write_text('1 0 0 0 0 1 0 0 0 0 1 0\n')
        self.fails(3, f'1 poses .* frame {len(self.scans) - 1}', self.arrays, '--poses', file, '--pose-frame', 'camera')

    def test_a_view_that_cannot_be_shown(self):
        lines = self.folder / 'loops.jsonl'
        lines.write_text('hello\n')
        for viewer, message in ((None, 'pip install rerun-sdk'), (mock.MagicMock(), 'loops.jsonl:1: expected a line of')):
            err = io.StringIO()
            with mock.patch.dict(sys.modules, {'rerun': viewer}), contextlib.redirect_stderr(err):
                self.assertNotEqual(show.main([str(lines)]), 0)
            self.assertIn(message, err.getvalue())

    def test_a_live_view_gets_points_path_and_loops(self):
        logged = []
        viewer = mock.MagicMock(log=lambda name, *_, **__: logged.append(name))
        lines = self.folder / 'loops.jsonl'
        self.assertEqual(run('loops', self.helipr, *SAME_MOMENT, '--format', 'jsonl', '--all', '-o', lines)[0], 0)
        with mock.patch.dict(sys.modules, {'rerun': viewer}):
            self.assertEqual(show.main([str(lines), str(self.helipr)]), 0)
        self.assertEqual(logged.count('scan'), 1 + len(self.scans))
        self.assertEqual(logged.count('map/path/0'), len(self.scans))
        self.assertEqual(logged.count('map/loops/0'), len(self.found))

    def test_ctrl_c_keeps_the_loops_so_far(self):
        data = save_arrays(self.folder / 'long', self.scans * 10)
        out = self.folder / 'loops.csv'
        process = subprocess.Popen([PROGRAM, 'loops', data, '--all', '-o', out], stderr=subprocess.PIPE, env=ENVIRONMENT)
        for _ in range(600):
            if out.exists() and out.read_text().count('\n') > 3:
                break
            time.sleep(0.05)
        process.send_signal(signal.SIGINT)
        err = process.communicate()[1].decode()
        self.assertEqual(process.returncode, 130, err)
        self.assertIn('interrupted', err)
        self.assertNotIn('Traceback', err)
        kept = out.read_text()
        self.assertGreater(kept.count('\n'), 3)
        self.assertTrue(kept.endswith('\n'))


class Faults(Command):
    def test_options_of_other_inputs(self):
        data = save_arrays(self.folder / 'drive', [room(i) for i in range(4)])
        self.fails(2, 'sequence /p: not supported', data, '--sequence', '/p')
        self.fails(2, '--follow: not supported for recordings', data, '--follow', 1)
        self.fails(2, 'seconds: the scans have no times', data, '--exclusion', 'seconds=3', '--sensor', 'hdl64', '-q', '-o',
                   self.folder / 'out')
        self.fails(3, 'No such file', self.folder / 'nowhere.bag')

    def test_scans_that_cannot_be_read_are_skipped(self):
        data = save_arrays(self.folder / os.fsdecode(b'Stra\xdfe'), [room(0), room(1), np.zeros((5, 2)), room(3)])
        code, out, err = run('loops', data, '--all', '--sensor', 'hdl64')
        self.assertEqual((code, len(out.splitlines())), (6, 4), err)
        self.assertRegex(err, r'000002\.npy: expected a floating-point array .*; the scan is skipped')
        self.assertIn('4 scans, 0 loops accepted: no scan had a candidate (exclusion meters=30), 1 scan skipped, 3 map entries', err)

    @unittest.skipUnless(HAVE_ROSBAGS, 'without the package rosbags: pip install rosbags')
    def test_invalid_bags_are_rejected(self):
        cloud, few = packed(room(1)[:500, :3]), ['-q', '--sensor', 'hdl64']
        for kind in KINDS:
            with self.subTest(kind):
                folder = self.folder / kind.replace(' ', '_')

                def bag(name, topics, kind=kind, folder=folder):
                    (folder / name).mkdir(parents=True)
                    return write_bag(folder / name, kind, topics)
                self.fails(3, r'no topic of PointCloud2.* /chatter \(std_msgs/msg/String\)', bag('none', {}), *few)
                self.fails(3, 'topic /p has no messages with points', bag('empty', {'/p': []}), *few)
                two = bag('two', {'/p': [cloud], '/q': [cloud]})
                self.fails(2, 'choose one of /p, /q with --sequence', two, *few)
                self.fails(2, 'no topic /r', two, '--sequence', '/r', *few)
                self.fails(3, 'field x: .* found int32', bag('integers', {'/p': [packed(room(1)[:500, :3], types='iff')]}), *few)
                path = bag('cut', {'/p': [cloud] * 20})
                file = path if path.is_file() else next(f for f in path.iterdir() if f.suffix in ('.mcap', '.db3'))
                whole = file.read_bytes()
                file.write_bytes(whole[:len(whole) * 2 // 3])
                code, out, err = run('loops', path, *few, '--all', '-o', folder / 'out.csv')
                self.assertEqual((code, out, err.count('\n')), (3, '', 1), err)
                self.assertRegex(err, '^revisit: .*cannot be read as a bag')
                file.write_bytes(b'')
                self.fails(3, 'cannot be read as a bag', path, *few)

    @unittest.skipUnless(HAVE_ROSBAGS, 'without the package rosbags: pip install rosbags')
    def test_an_empty_message_is_skipped(self):
        empty = packed(room(0)[:, :3])
        empty.width = empty.row_step = 0
        empty.data, empty.fields = empty.data[:0], []
        path = write_bag(self.folder, 'mcap', {'/p': [empty, *(packed(room(i)[:, :3]) for i in range(3))]})
        found = self.loops(path, '--sensor', 'hdl64', '--threshold', -9, '--no-verify', '--exclusion', 'none', code=6)
        self.assertEqual([line['frame'] for line in found], [2, 3])

    @unittest.skipUnless(HAVE_ROSBAGS, 'without the package rosbags: pip install rosbags')
    def test_poses_by_time(self):
        path = write_bag(self.folder, 'mcap', {'/p': [packed(room(i)[:, :3]) for i in range(3)]})
        file = self.folder / 'poses.txt'
        few = [path, '--sensor', 'hdl64', '--threshold', -9, '--poses', file, '--pose-frame', 'lidar', '--exclusion', 'none',
               '--no-verify']
        file.write_text(''.join(f'{1700000000 + 0.1 * i + 0.01:.2f} {i} 5 7 0 0 0 1\n' for i in range(3)))
        found = self.loops(*few)
        self.assertEqual([line['position'] for line in found], [{'x': i, 'y': 5, 'z': 7} for i in (1, 2)])
        self.fails(3, '3 of 3 scans have no pose within 0.001 s', *few, '--max-gap', 0.001)

    def test_without_rosbags_the_error_names_the_package(self):
        (self.folder / 'rosbags').mkdir()
        (self.folder / 'rosbags' / '__init__.py').write_text('raise ImportError("none")\n')
        file = self.folder / 'x.bag'
        file.touch()
        self.fails(1, 'pip install rosbags', file,
                   env=ENVIRONMENT | {'PYTHONPATH': f'{self.folder}:{ENVIRONMENT["PYTHONPATH"]}'})

    def test_without_this_package_the_error_names_the_command_to_install_it(self):
        self.fails(3, r"x\.bag: bags, packets and data sets are read by the Python package .* pip install '\.\[bags\]'",
                   self.put_bag(), env=ENVIRONMENT | {'PYTHONPATH': '', 'PYTHONNOUSERSITE': '1', 'PYTHONHOME': '', 'REVISIT_PYTHON': '/usr/bin/python3'})

    def put_bag(self):
        (self.folder / 'x.bag').touch()
        return self.folder / 'x.bag'


class Pieces(unittest.TestCase):
    def test_deskewing_uses_the_motion_from_the_previous_scan(self):
        times, wall = np.linspace(0, 0.1, 50, dtype=np.float32), np.float32([10, 3, 1])
        seen = (wall - np.outer(times, [8, 0, 0])).astype(np.float32)
        poses_ = [np.eye(4) for _ in range(3)]
        poses_[1][0, 3], poses_[2][0, 3] = 1.6, 3.2
        scans = [recordings.Scan(i, 0.2 * i, pose, lambda i=i: (seen, None if i == 2 else times), '')
                 for i, pose in enumerate(poses_)]
        for deskew in (True, False):
            taken = []
            detector = mock.Mock(take=lambda points, **_: taken.append(points))
            self.assertEqual(len(list(recognize(scans, detector, deskew))), 3)
            for i, points in enumerate(taken):  # the first has no previous scan, the last no times
                np.testing.assert_allclose(points[:, :3], np.tile(wall, (50, 1)) if deskew and i == 1 else seen, atol=1e-5)
        for wrong, kind in ((times[:9], ValueError), (times.astype(np.float64), TypeError)):
            with self.assertRaisesRegex(kind, 'times: expected'):
                datasets.deskew(seen, wrong, np.eye(4), 0.1)

    def test_a_local_map_accumulates_scans(self):
        walls = [np.float32([[5, y, z] for y in np.arange(-3, 3, 0.5) for z in np.arange(-1.5, 2, 0.5)])] * 12
        detector = revisit.LoopDetector(revisit.open_map(local_map=20))
        self.assertEqual(detector.take(walls[0], frame=0).error, '')
        for i, wall in enumerate(walls, 1):
            pose = np.eye(4)
            pose[0, 3] = i
            self.assertEqual(detector.take(wall, frame=i, pose=pose).error, '')

    def test_commands_of_the_package(self):
        with mock.patch.object(os, 'execve') as execute, mock.patch.object(sys, 'argv', ['revisit-loops', 'x.bag']), \
                mock.patch.object(os, 'access', lambda *_: True):
            program.loops()
            path_of_program = program.path()
        (path, words, environment), _ = execute.call_args
        self.assertEqual((path, words, environment['REVISIT_PYTHON']), (path_of_program, ['revisit', 'loops', 'x.bag'],
                                                                       os.environ.get('REVISIT_PYTHON', sys.executable)))
        err = io.StringIO()
        with mock.patch.object(os, 'access', lambda *_: False), contextlib.redirect_stderr(err):
            self.assertEqual(program.main(), 4)
        self.assertIn('built without the program', err.getvalue())


if __name__ == '__main__':
    unittest.main()
