"""revisit-loops: loops of bags, data sets and the C++ program are equal; errors are reported in one line."""

import contextlib
import csv
import io
import json
import os
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
from folders import FolderTest
from revisit import datasets, poses, program, recordings, simulation
from revisit.loops import command, lines, progress
from revisit.loops.recognize import recognize
from scans import room

PROGRAM = os.environ.get('REVISIT_PROGRAM', '')
if not os.access(PROGRAM, os.X_OK):
    PROGRAM = ''
SAME_MOMENT = ['--exclusion', 'frames=7', '--threshold', '0.3', '--drive', 'd', '--sensor', 'vlp16']


def run(*arguments):
    out, said = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(said):
        try:
            code = command.main([str(word) for word in arguments])
        except SystemExit as left:
            code = left.code
    return code, out.getvalue(), said.getvalue()


class Command(FolderTest):
    def loops(self, *arguments, code=0):
        left, out, said = run(*arguments, '--format', 'jsonl')
        self.assertEqual(left, code, said)
        return [json.loads(line) for line in out.splitlines()]

    def fails(self, code, says, *arguments):
        left, out, said = run(*arguments)
        self.assertEqual((left, out), (code, ''), said)
        self.assertEqual(said.count('\n'), 1, said)
        self.assertRegex(said, f'^revisit-loops: .*{says}')


class Drives(Command):
    """A simulated drive of a VLP-16 with revisits."""

    @classmethod
    def setUpClass(cls):
        folder = tempfile.TemporaryDirectory()
        cls.addClassCleanup(folder.cleanup)
        cls.town = Path(folder.name) / 'town'
        simulation.simulate(cls.town, length=300, sensor='vlp16', every=20, route='both')
        drive = datasets.open_dataset(cls.town, poses=True).scans
        cls.scans = [datasets.read_scan(ref.file)[:, :3] for ref in drive]
        cls.camera = np.array([ref.pose for ref in drive])
        cls.plain = Path(folder.name) / 'plain'
        cls.plain.mkdir()
        for i, points in enumerate(cls.scans):
            datasets.write_kitti_scan(cls.plain / f'{i:06}.bin', points)
        _, out, _ = run(cls.plain, *SAME_MOMENT, '--format', 'jsonl')
        cls.found = [json.loads(line) for line in out.splitlines()]

    def without(self, found, *names):
        return [{name: value for name, value in line.items() if name not in names} for line in found]

    def test_loops_are_of_places_driven_before(self):
        self.assertGreater(len(self.found), 5)
        for line in self.found:
            self.assertTrue(line['accepted'])
            self.assertGreater(line['frame'], line['match_frame'] + 7)
        apart = [np.linalg.norm((self.camera[line['frame']] - self.camera[line['match_frame']])[[0, 2], 3]) for line in self.found]
        self.assertLess(np.median(apart), 5)

    @unittest.skipUnless(HAVE_ROSBAGS, 'without the package rosbags: pip install rosbags')
    def test_bags_have_the_same_loops(self):
        for kind in KINDS[:3]:
            with self.subTest(kind):
                path = write_bag(self.folder, kind, {'/points': [packed(points) for points in self.scans]})
                found = self.loops(path, *SAME_MOMENT)
                self.assertEqual(self.without(found, 'time', 'match_time', 'file'), self.without(self.found, 'file'))
                self.assertTrue(found[0]['file'].startswith(str(path)))

    def test_loops_are_registered(self):
        found = {line['frame']: line for line in self.loops(self.plain, *SAME_MOMENT)}
        self.assertGreater(len(found), 3)
        for line in found.values():
            there = line['registered']
            self.assertTrue(there['accepted'])
            truth = np.linalg.inv(self.camera[line['match_frame']]) @ self.camera[line['frame']]
            # KITTI's camera has z forward and x right, and an offset from the lidar.
            self.assertLess(np.hypot(there['x'] - truth[2, 3], there['y'] + truth[0, 3]), 0.8)
        csv_rows = list(csv.DictReader(io.StringIO(run(self.plain, *SAME_MOMENT)[1])))
        self.assertEqual([(int(row['frame']), row['registered']) for row in csv_rows], [(frame, '1') for frame in found])
        if not PROGRAM:
            return
        done = subprocess.run([PROGRAM, 'loops', self.plain, *SAME_MOMENT, '--format', 'jsonl'], text=True,
                              capture_output=True, check=True)
        theirs = [json.loads(line) for line in done.stdout.splitlines()]
        self.assertEqual([line['frame'] for line in theirs], list(found))
        for line in theirs:
            one_way = np.sign(line['registered']['qw'])  # q and -q are one rotation
            for name, value in line['registered'].items():
                value *= one_way if name.startswith('q') else 1
                self.assertAlmostEqual(value, found[line['frame']]['registered'][name], delta=0.1, msg=name)

    @unittest.skipUnless(PROGRAM, 'without the C++ program: REVISIT_PROGRAM names none')
    def test_the_program_finds_the_same(self):
        readers = {'jsonl': lambda text: [json.loads(line) for line in text.splitlines()],
                   'csv': lambda text: list(csv.DictReader(io.StringIO(text), restkey='drive'))}
        for form, options in (('jsonl', ['--all']), ('csv', ['--every', '2', '--exclusion', 'frames=7'])):
            options = [*SAME_MOMENT, *options, '--no-verify', '--format', form]
            done = subprocess.run([PROGRAM, 'loops', self.plain, *options], text=True, capture_output=True, check=True)
            theirs, ours = ([line for line in readers[form](text) if line.get('match_frame') is not None]
                            for text in (done.stdout, run(self.plain, *options)[1]))
            self.assertGreater(len(theirs), 2)
            self.assertEqual([line['frame'] for line in theirs], [line['frame'] for line in ours])
            for one, other in zip(theirs, ours):
                self.assertLessEqual(one.keys(), other.keys())
                for name in one.keys() - {'drive'}:
                    if name == 'probability':  # a step function of the score
                        self.assertAlmostEqual(float(one[name]), float(other[name]), delta=0.2)
                    elif name in ('similarity', 'kth_similarity', 'score', 'yaw_deg') and one[name] not in ('', 'NaN'):
                        self.assertAlmostEqual(float(one[name]), float(other[name]), delta=0.02 if name == 'yaw_deg' else 1e-4)
                    else:
                        self.assertEqual(one[name], other[name], name)

    def test_poses_are_the_same_in_every_form(self):
        calib = self.town / 'sequences/00/calib.txt'
        lidar = poses.AXES_OF_CAMERA.T @ self.camera @ datasets.read_kitti_calibration(calib)
        given = {'camera': (self.camera, ['--calib', calib]), 'lidar': (lidar, [])}
        far = ['--exclusion', 'meters=60', *SAME_MOMENT[2:]]
        own = self.loops(self.town, *far)
        self.assertGreater(len(own), 5)
        apart = [np.hypot(*(line['position'][axis] - line['match_position'][axis] for axis in 'xz')) for line in own]
        self.assertLess(np.median(apart), 5)
        for frame, (matrices, more) in given.items():
            file = self.folder / 'poses.txt'
            np.savetxt(file, matrices[:, :3].reshape(-1, 12), fmt='%.12g')
            found = self.loops(self.plain, *far, '--poses', file, '--pose-frame', frame, *more,
                               '--poses-out', self.folder / 'out.txt')
            self.assertEqual(len(found), len(own))
            for one, other in zip(own, found):
                self.assertEqual(one['match_frame'], 20 * other['match_frame'])
                for axis in 'xyz':
                    self.assertAlmostEqual(one['position'][axis], other['position'][axis], places=6)
            out = poses.read_trajectory(self.folder / 'out.txt')
            frames = [line['frame'] for line in found]
            np.testing.assert_allclose(out.times, frames)
            of_lidar = lidar if frame == 'lidar' else poses.AXES_OF_CAMERA @ lidar
            np.testing.assert_allclose(out.poses, of_lidar[frames], atol=1e-5)

    def test_maps_are_kept(self):
        place = ['--map', self.folder / 'town.map', *SAME_MOMENT[:4]]
        self.loops(self.plain, *place, '--drive', 'first')
        again = self.loops(self.plain, *place, '--drive', 'second')
        self.assertEqual(len(again), len(self.scans))
        self.assertTrue(all(line['match_drive'] == 'first' and line['match_frame'] == line['frame'] for line in again))

    def test_pictures(self):
        with contextlib.suppress(ImportError):
            import matplotlib  # noqa: F401
            for data in (self.plain, self.town):
                file = self.folder / 'loops.png'
                self.assertEqual(run(data, *SAME_MOMENT, '--every', 24, '--plot', file, '-q')[0], 0)
                self.assertEqual(file.read_bytes()[1:4], b'PNG')
                file.unlink()
        with mock.patch.dict(sys.modules, {'matplotlib': None}):
            self.fails(1, 'pip install matplotlib', self.plain, '--plot', 'x.png')
        with mock.patch.dict(sys.modules, {'rerun': None}):
            self.fails(1, 'pip install rerun-sdk', self.plain, '--rerun')
        with mock.patch.object(program.Path, 'with_name', lambda *_: self.folder), mock.patch.dict(os.environ, {'PATH': ''}):
            self.fails(4, 'the program `revisit` is neither in this package nor on PATH', self.plain, '--report', 'x.html')
        if PROGRAM:
            page = self.folder / 'loops.html'
            with mock.patch.dict(os.environ, {'PATH': str(Path(PROGRAM).parent)}):
                self.assertEqual(run(self.plain, *SAME_MOMENT, '--every', 5, '--report', page, '-q')[0], 0)
            self.assertIn('jsonl', page.read_text())

    def test_ctrl_c_keeps_what_was_found(self):
        out = self.folder / 'loops.csv'
        went = subprocess.Popen([sys.executable, '-m', 'revisit.loops', self.plain, '--all', '-o', out], stderr=subprocess.PIPE)
        for _ in range(600):
            if out.exists() and out.read_text().count('\n') > 3:
                break
            time.sleep(0.05)
        went.send_signal(signal.SIGINT)
        said = went.communicate()[1].decode()
        self.assertEqual(went.returncode, 130, said)
        self.assertIn('interrupted; results so far are kept', said)
        kept = out.read_text()
        self.assertGreater(kept.count('\n'), 3)
        self.assertTrue(kept.endswith('\n'))


class Faults(Command):
    def setUp(self):
        super().setUp()
        self.scans = self.folder / 'scans'
        self.scans.mkdir()
        for i in range(4):
            datasets.write_kitti_scan(self.scans / f'{i}.bin', room(i))

    def test_help_has_examples(self):
        code, out, _ = run('--help')
        self.assertEqual(code, 0)
        self.assertIn('revisit-loops drive.bag  ', out)
        self.assertEqual(run(self.scans, '--nonsense')[0], 2)

    @unittest.skipUnless(PROGRAM and HAVE_ROSBAGS, 'without the C++ program, or the package rosbags')
    def test_the_program_reads_bags_by_this_package(self):
        path = write_bag(self.folder, KINDS[0], {'/points': [packed(room(i)) for i in range(4)]})
        environment = os.environ | {'REVISIT_PYTHON': sys.executable, 'PYTHONPATH': os.pathsep.join(filter(None, sys.path))}
        options = ['--all', '--sensor', 'hdl64', '--format', 'jsonl']
        done = subprocess.run([PROGRAM, 'loops', path, *options], text=True, capture_output=True, env=environment)
        self.assertEqual(done.returncode, 0, done.stderr)
        code, out, _ = run(path, *options)
        self.assertEqual((done.returncode, done.stdout), (code, out))
        done = subprocess.run([PROGRAM, 'loops', path, '--nonsense'], text=True, capture_output=True, env=environment)
        self.assertEqual(done.returncode, 2)

    def test_what_cannot_be_is_said(self):
        self.fails(2, "exclusion: expected .* found 'frames=x'", self.scans, '--exclusion', 'frames=x')
        self.fails(2, 'seconds: the scans have no times', self.scans, '--exclusion', 'seconds=3', '--sensor', 'hdl64', '-q', '-o',
                   self.folder / 'out')
        self.fails(2, '--pose-frame', self.scans, '--poses', 'x')
        for option in (['--verify'], ['--g2o', 'x'], ['--tum', 'x']):
            self.fails(2, f'--no-clouds: not with {option[0]}, which needs registered loops', self.scans, '--no-clouds', *option)
        self.fails(2, '--local-map: .* has no pose; give --poses', self.scans, '--local-map', 10)
        self.fails(2, '--target-precision 0.99999: no threshold reaches it; the best precision of the calibration is 0.99', self.scans,
                   '--sensor', 'hdl64', '-q', '--target-precision', 0.99999)
        self.fails(2, '--calib: needs --poses', self.scans, '--calib', 'x')
        self.fails(2, '--poses-out: the scans have no poses', self.scans, '--sensor', 'hdl64', '--threshold', 1, '--poses-out', 'x')
        self.fails(2, "no ring model for the sensor 'os7'", self.scans, '--sensor', 'os7')
        self.fails(3, 'no such file', self.folder / 'nowhere')
        self.fails(3, 'nowhere', self.scans, '--poses', self.folder / 'nowhere', '--pose-frame', 'lidar')
        self.fails(3, 'nowhere.ring', self.scans, '--ring', self.folder / 'nowhere.ring')
        self.fails(1, 'cannot be written', self.scans, '--sensor', 'hdl64', '--threshold', 1, '-o', self.folder / 'no' / 'where')
        (self.folder / 'empty').mkdir()
        self.fails(3, 'no scans here', self.folder / 'empty')

    def test_poses_of_another_time_are_no_poses(self):
        file = self.folder / 'poses.txt'
        file.write_text('0 0 0 0 0 0 0 1\n')
        self.fails(3, 'the scans have none', self.scans, '--poses', file, '--pose-frame', 'lidar')
        file.write_text('1 0 0 0 0 1 0 0 0 0 1 0\n')
        self.fails(3, '1 poses .* frame 3', self.scans, '--poses', file, '--pose-frame', 'camera')

    def test_scans_that_are_none_are_left_out(self):
        (self.scans / '2.bin').write_bytes(b'12345')
        code, out, said = run(self.scans, '--all')
        self.assertEqual(code, 6)
        self.assertEqual(len(out.splitlines()), 4)
        self.assertRegex(said, r'2\.bin.*scan skipped')
        self.assertIn('4 scans, 0 loops accepted: no scan had a candidate (exclusion frames=50), 1 scans skipped, '
                      '3 map entries', said)

    def test_names_may_be_any_bytes(self):
        latin = self.folder / os.fsdecode(b'Stra\xdfe')
        self.scans.rename(latin)
        (latin / '2.bin').write_bytes(b'12345')
        code, out, said = run(latin, '--all', '--sensor', 'hdl64')
        self.assertEqual((code, len(out.splitlines())), (6, 4), said)
        self.assertRegex(said, r'Stra\udcdfe/2\.bin.*scan skipped')

    def test_drives_may_have_any_names(self):
        name, file = os.fsdecode(b'Stra\xdfe'), self.folder / 'm.map'
        csv_file = self.folder / 'o.csv'
        for _ in range(2):
            code, _, said = run(self.scans, '--all', '--sensor', 'hdl64', '--drive', name, '--map', file, '-o', csv_file)
            self.assertEqual(code, 0, said)
        self.assertIn(b'Stra\xdfe', csv_file.read_bytes())
        [*_, line] = self.loops(self.scans, '--all', '--sensor', 'hdl64', '--drive', name, '--map', file)
        self.assertEqual(line['drive'], 'Stra\ufffde')  # JSON is text
        if PROGRAM:
            self.loops(self.scans, '--sensor', 'hdl64', '--drive', name, '--report', self.folder / 'o.html')

    def test_streams_may_be_closed(self):
        words = [sys.executable, '-m', 'revisit.loops', self.scans, '--all', '--sensor', 'hdl64']
        done = subprocess.run(words, stdout=subprocess.PIPE, preexec_fn=lambda: os.close(2), text=True)
        self.assertEqual((done.returncode, {line.count(',') for line in done.stdout.splitlines()}), (0, {29}), done.stdout)
        done = subprocess.run(words, stderr=subprocess.PIPE, preexec_fn=lambda: os.close(1), text=True)
        self.assertEqual(done.returncode, 1)
        self.assertIn('revisit-loops: standard output is closed; give -o FILE', done.stderr)
        self.assertNotIn('Traceback', done.stderr)

    def test_terminals_are_not_commanded(self):
        self.fails(3, r'\\x1b\[2J: no such file', self.folder / '\x1b[2J')

    def test_faults_of_others_are_one_line(self):
        for error, says in ((KeyError('x'), "KeyError: 'x'"), (MemoryError(), 'out of memory')):
            with mock.patch.object(command, 'work', side_effect=error):
                self.fails(1, says, self.scans)

    @unittest.skipUnless(HAVE_ROSBAGS, 'without the package rosbags: pip install rosbags')
    def test_bags_that_are_none(self):
        cloud, few = packed(room(1)[:500, :3]), ['-q', '--sensor', 'hdl64']
        for kind in KINDS:
            with self.subTest(kind):
                folder = self.folder / kind.replace(' ', '_')

                def bag(name, topics, kind=kind, folder=folder):
                    (folder / name).mkdir(parents=True)
                    return write_bag(folder / name, kind, topics)
                self.fails(3, r'no topic of PointCloud2 .* /chatter \(std_msgs/msg/String\)', bag('none', {}), *few)
                self.fails(3, 'topic /p has no messages with points', bag('empty', {'/p': []}), *few)
                two = bag('two', {'/p': [cloud], '/q': [cloud]})
                self.fails(2, 'choose one of /p, /q with --topic', two, *few)
                self.fails(2, 'no topic /r', two, '--topic', '/r', *few)
                self.fails(3, 'field x: .* found int32', bag('integers', {'/p': [packed(room(1)[:500, :3], types='iff')]}), *few)
                path = bag('cut', {'/p': [cloud] * 20})
                file = path if path.is_file() else next(f for f in path.iterdir() if f.suffix in ('.mcap', '.db3'))
                whole = file.read_bytes()
                file.write_bytes(whole[:len(whole) * 2 // 3])
                code, out, said = run(path, *few, '--all', '-o', folder / 'out.csv')
                self.assertEqual((code, out, said.count('\n')), (3, '', 1), said)
                self.assertRegex(said, '^revisit-loops: .*cannot be read as a bag')
                file.write_bytes(b'')
                self.fails(3, 'cannot be read as a bag', path, *few)

    @unittest.skipUnless(HAVE_ROSBAGS, 'without the package rosbags: pip install rosbags')
    def test_an_empty_message_is_left_out(self):
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
        self.assertEqual([line['position'] for line in found], [{'x': -5, 'y': -7, 'z': i} for i in (1, 2)])
        self.fails(3, '3 of 3 scans have no pose within 0.001 s', *few, '--max-gap', 0.001)

    def test_without_rosbags_it_says_what_to_install(self):
        file = self.folder / 'x.bag'
        file.touch()
        with mock.patch.dict(sys.modules, {'rosbags': None}):
            self.fails(1, 'pip install rosbags', file)


class Pieces(unittest.TestCase):
    def test_motion_is_taken_out_by_the_way_from_the_scan_before(self):
        times, wall = np.linspace(0, 0.1, 50, dtype=np.float32), np.float32([10, 3, 1])
        seen = (wall - np.outer(times, [8, 0, 0])).astype(np.float32)
        poses_ = [np.eye(4) for _ in range(3)]
        poses_[1][0, 3], poses_[2][0, 3] = 1.6, 3.2
        scans = [recordings.Scan(i, 0.2 * i, pose, lambda: seen, '', lambda i=i: (seen, None if i == 2 else times))
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

    def test_a_local_map_makes_a_scan_of_what_was_passed(self):
        walls = [np.float32([[5, y, z] for y in np.arange(-3, 3, 0.5) for z in np.arange(-1.5, 2, 0.5)])] * 12
        detector = revisit.LoopDetector(revisit.open_map(None, 'hdl64'), local_map=20)
        self.assertIn('scan 0 has no pose', detector.take(walls[0], frame=0).error)
        for i, wall in enumerate(walls):
            pose = np.eye(4)
            pose[0, 3] = i
            self.assertEqual(detector.take(wall, frame=i, pose=pose).error, '')

    def test_a_package_of_the_engine_alone_says_so(self):
        said = io.StringIO()
        with contextlib.redirect_stderr(said), mock.patch.object(revisit, '_core', object()):
            self.assertEqual(program.loops(), 4)
        self.assertRegex(said.getvalue(), '^revisit-loops: this package has only the engine')

    def test_lines(self):
        self.assertEqual(lines.json_text({'frame': 3, 'score': float('nan')}), '{"frame":3,"score":"NaN"}')
        cells = dict(zip([*lines.COLUMNS, 'drive'], lines.cells_of(
            {'frame': 3, 'time': 0.5, 'accepted': True, 'yaw_deg': 12.346, 'position': {'x': 1.0, 'y': 2.0, 'z': 3.5}, 'drive': 'a'})))
        self.assertEqual((cells['time'], cells['accepted'], cells['yaw_deg'], cells['here_z'], cells['match_x'], cells['drive']),
                         ('0.500000', '1', '12.35', '3.500', '', 'a'))

    def test_progress(self):
        said = io.StringIO()
        with contextlib.redirect_stderr(said), mock.patch.object(progress, 'EVERY', 0):
            self.assertEqual(list(progress.with_progress(range(4), 4, True)), [0, 1, 2, 3])
            self.assertEqual(list(progress.with_progress(range(4), None, False)), [0, 1, 2, 3])
        self.assertRegex(said.getvalue(), r'recognizing 2/4 scans, [\d.]+ scans/s, 0:00 left')


if __name__ == '__main__':
    unittest.main()
