"""Runs the programs of examples/ with synthetic networks and a simulated drive."""

import importlib.util
import os
import re
import shutil
import subprocess
import sys
import unittest
from pathlib import Path

import numpy as np

from folders import FolderTest
from nets import CONVOLVE
from revisit import datasets, poses, proto, recordings
from scans import room, simulate

EXAMPLES = Path(__file__).resolve().parents[2] / 'examples'
SLAM = all(importlib.util.find_spec(name) for name in ('kiss_icp', 'gtsam', 'evo', 'matplotlib'))

ODOMETRY_OF_FILE = """
from pathlib import Path
import numpy as np

class KISSConfig:
    def __init__(self, **settings):
        pass

class KissICP:
    def __init__(self, config):
        self.path = iter(np.load(Path(__file__).parents[1] / 'path.npy'))

    def register_frame(self, points, times):
        self.last_pose = next(self.path)
"""


def run(name, *arguments):
    done = subprocess.run([sys.executable, EXAMPLES / f'{name}.py', *map(str, arguments)],
                          text=True, capture_output=True)
    if done.returncode:
        raise AssertionError(f'{name}: {done.stdout}{done.stderr}')
    return done.stdout


class Examples(FolderTest):
    def setUp(self):
        super().setUp()
        self.prototxt = self.folder / 'net.prototxt'
        self.prototxt.write_text(CONVOLVE)

    def test_classify_image(self):
        # The fourth channel copies blue, the fourth class sums it: blue images are of class 3.
        conv, fc = np.zeros((4, 3, 3, 3), np.float32), np.zeros((5, 80), np.float32)
        conv[3, 0, 1, 1] = 1
        fc[3, 60:] = 0.01
        net = proto.read_net(self.prototxt)
        net.set_weights({'conv': [conv, np.zeros(4, np.float32)], 'fc': [fc, np.zeros(5, np.float32)]})
        net.write_binary(self.folder / 'net.caffemodel')
        (self.folder / 'labels.txt').write_text('red\ngreen\ngray\nblue\nwhite\n')
        image = np.zeros((8, 10, 3), np.uint8)
        image[:, :, 2] = 255
        np.save(self.folder / 'image.npy', image)
        printed = run('classify_image', self.prototxt, self.folder / 'net.caffemodel',
                      self.folder / 'image.npy', '--labels', self.folder / 'labels.txt', '--top', 2).splitlines()
        self.assertEqual(len(printed), 2)
        self.assertRegex(printed[0], r'^1\.0000  blue$')

    def test_loop_closures(self):
        simulate(self.folder / 'town', length=600, every=20)
        printed = run('loop_closures', self.folder / 'town', '--threshold', 0, '--exclusion', 'frames=400',
                      '--map', self.folder / 'town.map')
        loops = printed.splitlines()[1:]
        self.assertGreater(len(loops), 2)
        for loop in loops:
            frame, _, match = loop.split(',')[:3]
            self.assertGreater(int(frame), int(match) + 300)
        self.assertTrue((self.folder / 'town.map').is_file())

    @unittest.skipUnless(SLAM, 'needs kiss-icp, gtsam, evo and matplotlib: pip install kiss-icp gtsam evo matplotlib')
    def test_slam(self):
        """The corrected trajectory of a drive around a block and back is more accurate than odometry."""
        simulate(self.folder / 'town', length=300, every=2, route='both', sensor='vlp16')
        printed = run('slam', self.folder / 'town', '-o', self.folder)
        found, fit = map(int, re.search(r"(\d+) loops, (\d+) with a residual", printed).groups())
        self.assertGreater(fit, 20)
        self.assertGreater(fit, 0.9 * found)
        before, after = (float(re.search(rf'{name} ([\d.]+) m', printed)[1]) for name in ('odometry', 'corrected'))
        self.assertLess(after, before + 0.02)
        self.assertLess(after, 0.5)
        lines = (self.folder / 'trajectory.tum').read_text().splitlines()
        self.assertEqual(len(lines), len(list((self.folder / 'town').glob('sequences/00/velodyne/*.bin'))))
        self.assertEqual((self.folder / 'trajectory.png').read_bytes()[1:4], b'PNG')

    def slam(self, *arguments, path=()):
        env = os.environ | {'PYTHONPATH': os.pathsep.join([*map(str, path), os.environ.get('PYTHONPATH', '')])}
        done = subprocess.run([sys.executable, EXAMPLES / 'slam.py', *map(str, arguments), '-o', self.folder / 'out'],
                              text=True, capture_output=True, env=env)
        return done.returncode, done.stdout, done.stderr

    def test_slam_names_missing_packages(self):
        (self.folder / 'kiss_icp.py').write_text('raise ImportError("No module named \'kiss_icp\'")')
        code, _, said = self.slam(self.folder, path=[self.folder])
        self.assertEqual(code, 1)
        self.assertRegex(said, r"^slam: No module named '\w+'; .*pip install '\.\[slam\]'\n$")

    @unittest.skipUnless(SLAM, 'needs kiss-icp, gtsam, evo and matplotlib: pip install kiss-icp gtsam evo matplotlib')
    def test_slam_with_diverged_odometry(self):
        """Odometry that climbs 5 cm per meter contradicts the loops of a level drive."""
        simulate(self.folder / 'town', length=300, every=2, route='both', sensor='vlp16')
        path = np.array([poses.AXES_OF_CAMERA.T @ scan.pose for scan in recordings.open_recording(str(self.folder / 'town')).scans()])
        path[:, 2, 3] += 0.1 * np.arange(len(path))
        np.save(self.folder / 'path.npy', path)
        (self.folder / 'kiss_icp').mkdir()
        (self.folder / 'kiss_icp/__init__.py').touch()
        (self.folder / 'kiss_icp/kiss_icp.py').write_text(ODOMETRY_OF_FILE)
        code, printed, said = self.slam(self.folder / 'town', path=[self.folder])
        self.assertEqual(code, 5, printed + said)
        self.assertRegex(said, r'slam: the odometry has diverged: \d+ loops agree with it, .* because it excludes them\n$')
        self.assertEqual(len((self.folder / 'out/trajectory.tum').read_text().splitlines()), len(path))

    @unittest.skipUnless(SLAM, 'needs kiss-icp, gtsam, evo and matplotlib: pip install kiss-icp gtsam evo matplotlib')
    def test_slam_with_damaged_scans(self):
        """A folder without poses whose third scan is truncated, a folder without scans, and an unwritable output."""
        scans = self.folder / 'scans'
        scans.mkdir()
        code, _, said = self.slam(scans)
        self.assertEqual((code, said.count('\n')), (3, 1), said)
        for i in range(3):
            datasets.write_kitti_scan(scans / f'{i:06}.bin', room(1, shift=(2 * i, 0)))
        (scans / '000002.bin').write_bytes(b'cut off')
        code, printed, said = self.slam(scans, '--sensor', 'hdl64')
        self.assertEqual((code, said.count('\n')), (3, 1), said)
        self.assertRegex(printed, '^2 scans, 2 keyframes, 0 loops')
        self.assertIn('000002.bin', said)
        self.assertEqual(len((self.folder / 'out/trajectory.tum').read_text().splitlines()), 2)
        self.assertTrue((self.folder / 'out/trajectory.png').is_file())
        shutil.rmtree(self.folder / 'out')
        (self.folder / 'out').write_text('a file')
        code, _, said = self.slam(scans, '--sensor', 'hdl64')
        self.assertEqual((code, said.count('\n')), (1, 1), said)


if __name__ == '__main__':
    unittest.main()
