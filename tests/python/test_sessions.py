"""Sessions with one map, by `revisit loops` and `revisit map build`: resumed, killed, equal names, concurrent, merged."""

import json
import os
import signal
import subprocess
import tempfile
import time
import unittest
from collections import Counter
from pathlib import Path

import numpy as np

import revisit
from folders import FolderTest
from revisit import maps
from scans import simulate

PROGRAM = os.environ.get('REVISIT_PROGRAM', '')
EXCLUDED = 8
"""Number of previous scans that are excluded."""
LOOPS = ['--exclusion', f'frames={EXCLUDED}', '--format', 'jsonl', '-q']
COMMANDS = {
    'loops': [PROGRAM, 'loops', *LOOPS],
    'build': [PROGRAM, 'map', 'build', '-q'],
}


def places(file):
    """Checks the map and returns (drive, frame) of each place."""
    assert maps.check_map(file) == [], maps.check_map(file)
    return [(entry.drive, entry.frame) for entry in maps.MapStore.open(file).entries()]


def loops_of(text):
    """Returns frame -> drive and frame of the match. Checks that no match is the scan itself or a temporal neighbor."""
    lines = [json.loads(line) for line in text.splitlines()]
    for line in lines:
        assert line['match_drive'] != line['drive'] or line['match_frame'] < line['frame'] - EXCLUDED, line
    return {line['frame']: (line['match_drive'], line['match_frame']) for line in lines}


@unittest.skipUnless(os.access(PROGRAM, os.X_OK), 'without the C++ program: REVISIT_PROGRAM names none')
class Sessions(FolderTest):
    @classmethod
    def setUpClass(cls):
        folder = tempfile.TemporaryDirectory()
        cls.addClassCleanup(folder.cleanup)
        town = Path(folder.name) / 'town'
        simulate(town, length=300, sensor='vlp16', every=12, route='both')
        cls.scans = sorted((town / 'sequences/00/velodyne').glob('*.bin'))
        cls.whole = Path(folder.name) / 'whole'
        cls.folder_of(cls.whole, cls.scans)
        cls.every_place = [('whole', frame) for frame in range(len(cls.scans))]

    @staticmethod
    def folder_of(folder, scans, names=None):
        folder.mkdir(parents=True)
        for i, scan in enumerate(scans):
            (folder / f'{names[i] if names else i:06}.bin').symlink_to(scan)
        return folder

    def start(self, name, data, file, *more):
        return subprocess.Popen([*map(str, COMMANDS[name]), str(data), '--map', str(file), '--warmup', '12', *map(str, more)],
                                text=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE)

    def run_to_end(self, name, data, file, *more, code=0):
        process = self.start(name, data, file, *more)
        out, said = process.communicate()
        self.assertEqual(process.returncode, code, said)
        return out, said

    def test_killed_at_ten_moments(self):
        for name in COMMANDS:
            with self.subTest(name):
                undisturbed, file = self.folder / f'{name}.undisturbed.map', self.folder / f'{name}.map'
                expected, _ = self.run_to_end(name, self.whole, undisturbed)
                found = ''
                for moment in range(10):
                    process = self.start(name, self.whole, file, '--threads', 1)
                    self.wait_for_places(process, file, moment * len(self.scans) // 10)
                    time.sleep(0.01 * moment)
                    process.send_signal(signal.SIGKILL)
                    out, _ = process.communicate()
                    found += out[:out.rfind('\n') + 1]
                    there = places(file) if file.exists() else []
                    self.assertEqual(there, self.every_place[:len(there)])
                rest, _ = self.run_to_end(name, self.whole, file)
                self.assertEqual(places(file), self.every_place)
                if name != 'build':
                    self.assertGreater(len(loops_of(expected)), 12)
                    self.assertEqual(loops_of(found + rest), loops_of(expected))
                    self.assertEqual(loops_of(rest), loops_of(expected))

    def wait_for_places(self, process, file, n):
        while process.poll() is None:
            if file.exists() and len(maps.MapStore.open(file)) >= n:
                return
            time.sleep(0.002)

    def test_folders_of_one_name(self):
        half = len(self.scans) // 2
        monday = self.folder_of(self.folder / 'monday/scans', self.scans[:half])
        tuesday = self.folder_of(self.folder / 'tuesday/scans', self.scans[half:])
        seconds = range(100_000_000, 100_000_000 + 10 * half, 10)
        third = self.folder_of(self.folder / 'third/scans', self.scans[:half], seconds)  # named by time
        next_day = self.folder_of(self.folder / 'fourth/scans', self.scans[half:2 * half], [s + 86400 for s in seconds])
        for name in COMMANDS:
            with self.subTest(name):
                file = self.folder / f'{name}.map'
                expected = Counter()
                for number, (folder, n) in enumerate([(monday, half), (tuesday, len(self.scans) - half), (third, half),
                                                      (next_day, half)], 1):
                    expected['scans' if number == 1 else f'scans-{number}'] = n
                    for _ in range(2):  # the second time it is resumed
                        _, said = self.run_to_end(name, folder, file)
                        self.assertEqual(Counter(drive for drive, _ in places(file)), expected, said)
                self.run_to_end(name, monday, file)
                self.assertEqual(len(places(file)), sum(expected.values()))

    def test_a_removed_place_is_described_again(self):
        file = self.folder / 'one.map'
        self.run_to_end('build', self.whole, file)
        with maps.MapStore.open(file, write=True) as store:
            store.remove([1, 5])
        self.run_to_end('build', self.whole, file)
        self.assertEqual(sorted(places(file)), self.every_place)

    def test_two_robots_are_merged(self):
        half = len(self.scans) // 2
        files = [self.folder / name for name in ('a.map', 'b.map', 'both.map', 'more.map')]
        for i, scans in enumerate((self.scans[:half], self.scans[half:])):
            self.run_to_end('build', self.folder_of(self.folder / f'{i}/scans', scans), files[i], '--warmup', 200)
        self.merge(files[:2], files[2])
        both = Counter({'scans': half, 'b/scans': len(self.scans) - half})
        self.assertEqual(Counter(drive for drive, _ in places(files[2])), both)
        self.merge([files[2], files[1], files[0]], files[3])  # no place is duplicated
        self.assertEqual(Counter(drive for drive, _ in places(files[3])), both)
        subprocess.run([PROGRAM, 'map', 'remove', files[2], '--drive', 'scans'], check=True, capture_output=True)
        self.assertEqual({drive for drive, _ in places(files[2])}, {'b/scans'})
        self.merge([files[0], files[0]], self.folder / 'itself.map', code=2)
        self.assertFalse((self.folder / 'itself.map').exists())

    def merge(self, files, output, code=0):
        done = subprocess.run([PROGRAM, 'map', 'merge', *files, '-o', output], text=True, capture_output=True)
        self.assertEqual(done.returncode, code, done.stderr)

    def test_several_write_at_once(self):
        """Only one process writes at a time. The others are rejected, and lose nothing when they are run again."""
        third = len(self.scans) // 3
        parts = [self.scans[:third], self.scans[third:2 * third], self.scans[2 * third:]]
        folders = [self.folder_of(self.folder / f'{i}/scans', part) for i, part in enumerate(parts)]
        file, waiting = self.folder / 'one.map', folders
        for _ in folders:
            racing = [(folder, self.start('build', folder, file, '--warmup', 200)) for folder in waiting]
            waiting = []
            for folder, process in racing:
                _, said = process.communicate()
                self.assertIn(process.returncode, (0, 1), said)
                if process.returncode:
                    self.assertIn('another process is writing', said)
                    waiting.append(folder)
            self.assertLess(len(waiting), len(racing))
        self.assertEqual(waiting, [])
        stored = {(entry.drive, entry.frame): np.array(entry.feature) for entry in maps.MapStore.open(file).entries()}
        self.assertEqual(len(stored), len(self.scans))
        for i, folder in enumerate(folders):
            alone = self.folder / f'{i}.map'
            self.run_to_end('build', folder, alone, '--warmup', 200)
            own = {entry.frame: np.array(entry.feature) for entry in maps.MapStore.open(alone).entries()}
            drives = [drive for drive in ('scans', 'scans-2', 'scans-3')
                      if all(np.array_equal(stored.get((drive, frame)), feature) for frame, feature in own.items())]
            self.assertEqual(len(drives), 1)

    def test_failures_leave_no_map(self):
        file, few = self.folder / 'new.map', self.folder / 'few.map'
        self.run_to_end('build', self.whole, few, '--every', 30)
        for name, code, says, more in (('build', 3, 'warm-up not complete', ['--projection-from', few]),
                                       ('loops', 3, 'warm-up not complete', ['--projection-from', few]),
                                       ('build', 2, 'expected at least 2 entries', ['--warmup', 0]),
                                       ('loops', 1, 'cannot be written', ['-o', '/nowhere/loops.csv'])):
            with self.subTest(name, says=says):
                _, said = self.run_to_end(name, self.whole, file, *more, code=code)
                self.assertIn(says, said)
                self.assertFalse(file.exists())

    def test_the_model_of_a_map_comes_first(self):
        for name in COMMANDS:
            with self.subTest(name):
                file = self.folder / f'{name}.map'
                self.run_to_end(name, self.whole, file, '--every', 4, '--sensor', 'hdl64')
                process = subprocess.run([word for word in [*COMMANDS[name], self.whole, '--map', file] if word != '-q'],
                                         text=True, capture_output=True)
                self.assertEqual(process.returncode, 0, process.stderr)
                self.assertIn('hdl64 (of the map; the nearest to the scans is vlp16', process.stderr)
                self.assertEqual(len(places(file)), len(self.scans))
        self.run_to_end('build', self.whole, self.folder / 'vlp16.map', '--every', 4)
        self.assertEqual(len(revisit.open_map(self.folder / 'vlp16.map')), -(-len(self.scans) // 4))


if __name__ == '__main__':
    unittest.main()
