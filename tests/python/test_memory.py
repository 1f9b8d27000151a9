"""A long drive needs a few kB of memory per scan for descriptors, and none for points.

REVISIT_MEMORY_SCANS=20000 prints the memory of such a drive, without and with a map.
"""

import os
import unittest

import numpy as np

import revisit
from folders import FolderTest
from revisit.loops import recognize
from revisit.recordings import Scan

GIVEN = int(os.environ.get('REVISIT_MEMORY_SCANS', 0))


def points_of(frame):
    """Random walls, poles and ground; every fifth scan repeats one of the first 100."""
    random = np.random.default_rng(frame % 100 if frame % 5 == 4 else frame)
    things = random.uniform([-50, -50, 0.2, 1, 0], [50, 50, 12, 8, 6.28], (60, 5))
    x, y, along, up, heading = things.repeat(75, axis=0).T
    along *= random.random(len(along))
    walls = np.stack([x + along * np.cos(heading), y + along * np.sin(heading), random.uniform(-1.7, up)], axis=1)
    ground = random.uniform([-40, -40, -1.73], [40, 40, -1.73], (3000, 3))
    return np.concatenate([walls, ground]).astype(np.float32)


def resident_bytes():
    with open('/proc/self/statm') as statm:
        return int(statm.read().split()[1]) * os.sysconf('SC_PAGESIZE')


class Memory(FolderTest):
    def test_a_long_drive_takes_descriptors_only(self):
        marks = [200, 400] if not GIVEN else [mark for mark in (1000, 2000, 5000, 10000, 20000) if mark <= GIVEN]
        for file in (None, self.folder / 'long.map'):
            with self.subTest(file):
                map_ = revisit.open_map(file, 'vlp16', warmup=200 if GIVEN else 20)
                detector = revisit.LoopDetector(map_, drive='long', exclusion='frames=50', verify=True)
                scans = (Scan(frame, None, None, lambda frame=frame: (points_of(frame), None), f'scan {frame}') for frame in range(marks[-1]))
                bytes_at, registered = {}, 0
                for visit in recognize(scans, detector):
                    registered += visit.found.registered is not None
                    if (done := visit.scan.frame + 1) in marks:
                        bytes_at[done] = resident_bytes()
                        if GIVEN:
                            print(f'{"without map" if file is None else "map on disk"}, {done:6} scans: {bytes_at[done] / 1e6:.1f} MB',
                                  flush=True)
                self.assertGreater(registered, 20)
                self.assertLess((bytes_at[marks[-1]] - bytes_at[marks[0]]) / (marks[-1] - marks[0]), 6000)


if __name__ == '__main__':
    unittest.main()
