"""Tests of bench, whose metrics are in docs/RESULTS.md."""

import json
import sys
import tempfile
import unittest
from pathlib import Path
from types import SimpleNamespace
from unittest import mock

import numpy as np
from revisit import program, recognition
from scans import room

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / 'bench'))
import acceptance  # noqa: E402
import discriminants  # noqa: E402
import drives  # noqa: E402
import rows  # noqa: E402
import tables  # noqa: E402


def there_and_back(length=200, step=2, beside=1, **rule):
    """A street in both directions: place k of the first direction is next to place 2 n - 1 - k."""
    x = np.arange(0, length, step, float)
    at = np.zeros((2 * len(x), 3))
    at[:, 0], at[len(x):, 1] = np.r_[x, x[::-1]], beside
    scans = [SimpleNamespace(file=f'{i}', frame=i) for i in range(len(at))]
    return drives.Drive(scans, at, exclusion='meters=50', **rule)


def answers_to(drive, given):
    return [given.get(query, (None, 0, False)) for query in drive.queries]


class Drives(unittest.TestCase):
    def test_metrics_by_hand(self):
        drive = there_and_back()
        self.assertEqual((drive.queries[0], drive.candidates[0]), (26, 1))  # 50 m are 25 scans
        # Correct, correct, 8 m off (ignored), incorrect; then a query without a place, with a low score. Others find nothing.
        given = {199: (0, 5, True), 198: (1, 4, False), 197: (6, 3, True), 196: (60, 2, True), 60: (0, 1, False)}
        found = drives.metrics(drive, answers_to(drive, given))
        positives = found['n_positives']
        self.assertEqual((found['n_queries'], positives), (174, 88))
        self.assertAlmostEqual(found['recall_at_1'], 2 / positives)
        # Two are found before the first incorrect match; the precision of those without an answer is that of all.
        self.assertAlmostEqual(found['max_recall_at_precision_1'], 2 / (positives - 1))
        self.assertAlmostEqual(found['average_precision'], 2 / (positives - 1))
        self.assertEqual(found['loops'], {'correct': 1, 'ignored': 1, 'incorrect': 1})

    def test_keyframes_lie_so_far_from_the_one_before(self):
        drive = there_and_back(length=200, keyframes=3)
        self.assertEqual(list(drive.stored[:3]), [0, 2, 4])
        self.assertEqual(len(drive.queries), 174)

    def test_judges_as_revisit_eval(self):
        with tempfile.TemporaryDirectory() as folder:
            town, pairs = f'{folder}/town', f'{folder}/pairs.csv'
            program.run('simulate', '-o', town, '--sensor', 'vlp16', '--route', 'both', '--length', 300, '--every', 8)
            program.run('eval', town, '--ground-truth', pairs, '--exclusion', 'frames=20')
            for options in ({'exclusion': 'meters=50', 'keyframes': 'meters=6'}, {'exclusion': 'frames=20', 'pairs': f'{pairs},near=1'}):
                with self.subTest(**options):
                    words = [word for name, value in options.items() for word in (f'--{name}', value)]
                    blocks = '1000,frames=50' if 'pairs' in options else '1000'  # as without poses
                    program.run('eval', town, '--feature', 'm2dp', '--bootstrap', blocks, '-o', folder, '--no-report', *words)
                    task, = json.loads(Path(folder, 'town_00/latest/run.json').read_text())['tasks']
                    drive = drives.open_drive(town, **options)
                    self.assertEqual(drive.queries, task['scan'])
                    found = drives.metrics(drive, [(*answer, None) for answer in zip(task['match'], task['score'])])
                    self.assertLess(found['average_precision'], 1)
                    for name, value in found.items():
                        np.testing.assert_allclose(value, task['metrics'][name], atol=1e-6, err_msg=name)


class Discriminants(unittest.TestCase):
    def test_a_turned_context_is_the_same(self):
        describe = recognition.from_scan(recognition.scan_context_features())
        contexts = np.array([describe(points) for points in (room(1), room(2), room(1, turn=np.radians(90)))])
        directions = [np.eye(20)] * discriminants.FREQUENCIES
        numbers = discriminants.descriptors('scan-context', contexts, 0, directions)
        to_room, to_other = discriminants.similarities(numbers, 2, np.arange(2))
        self.assertGreater(to_room, 0.99)
        self.assertLess(to_other, to_room)

    def test_learns_which_numbers_stay(self):
        rng = np.random.default_rng(1)
        places = rng.normal(size=(200, 192))
        places[:, 96:] = 0
        seen = [places + np.r_[np.full(96, 0.1), np.full(96, 3)] * rng.normal(size=places.shape) for _ in range(2)]
        features = np.concatenate(seen)[:, None].astype(np.float32)
        pairs = np.c_[np.arange(200), np.arange(200, 400)]
        directions = discriminants.learn('m2dp', [{'m2dp': features, 'pairs': pairs, 'turns': np.zeros(200)}])
        weights = (np.abs(directions[0]) ** 2).sum(1)
        self.assertGreater(weights[:96].sum(), 20 * weights[96:].sum())


class Tables(unittest.TestCase):
    def test_a_row_takes_the_place_of_its_older_one_and_of_none_else(self):
        with tempfile.TemporaryDirectory() as folder, mock.patch.object(tables, 'DATA', Path(folder)):
            file = Path(folder, 'rows.json')
            for ap in (0.5, 0.25):
                for name in ('a', 'b'):
                    rows.keep(file, {'drive': 'd', 'name': name, 'ap': ap})
            self.assertEqual(len(json.loads(file.read_text())), 2)
            page = ['text', '<!-- table: rows.json columns=ap,accepted_incorrect -->', '| old |', 'more']
            (begin, end, right), = tables.tables_in(page)
        self.assertEqual((begin, end), (2, 3))
        self.assertEqual(right[2:], ['| d | a | 0.250 | - |', '| d | b | 0.250 | - |'])

    def test_perturbations_stand_side_by_side(self):
        with tempfile.TemporaryDirectory() as folder, mock.patch.object(tables, 'DATA', Path(folder)):
            for name, perturbation, ap in (('a', 'none', 1.0), ('b', 'none', 0.5), ('a', 'turn', 0.25)):
                rows.keep(Path(folder, 'perturbed.json'), {'drive': 'd', 'name': name, 'perturbation': perturbation, 'ap': ap})
            (_, _, right), = tables.tables_in(['<!-- table: perturbed.json drive=d columns=ap -->'])
        self.assertEqual(right, ['| perturbation | d, a: AP | d, b: AP |', '|---|---|---|', '| none | 1.000 | 0.500 |', '| turn | 0.250 | - |'])

    def test_towns_have_their_mean_and_the_lowest(self):
        with tempfile.TemporaryDirectory() as folder, mock.patch.object(tables, 'DATA', Path(folder)):
            for town, ap, keyframes in ((11, 0.5, 1.0), (12, 0.75, 1.0), (13, 0.1, None)):
                row = {'drive': f'town{town}-08-ouster-os1-64', 'name': 'a', 'ap': ap, 'ap_interval': [ap - 0.1, 1], 'with_place': 3, 'accepted_correct': 2, 'accepted_incorrect': 1}
                rows.keep(Path(folder, 'towns.json'), row | ({'keyframes': keyframes} if keyframes else {}))
            rows.keep(Path(folder, 'towns.json'), {'drive': 'town:11', 'name': 'a', 'ap': 1.0, 'keyframes': 1.0})
            (_, _, right), = tables.tables_in(['<!-- table: towns.json keyframes=1.0 routes=08,06 -->'])
        self.assertEqual(right[2:], ['| ouster-os1-64 | a | 0.625 (2) | - | 0.500 | 0.400 to 1 | 4 of 6 | 2 |'])


class Acceptance(unittest.TestCase):
    @staticmethod
    def line(query, place, moved=0.0, turned=0.0):
        """An accepted loop, registered `moved` meters along x and `turned` half turns of yaw from the place."""
        registered = dict(x=moved, y=0.0, z=0.0, qx=0.0, qy=0.0, qz=np.sin(turned * np.pi / 2), qw=np.cos(turned * np.pi / 2))
        return {'frame': query, 'match_frame': place, 'accepted': True, 'registered': registered}

    def test_counts_by_the_registered_pose(self):
        poses = acceptance.homogeneous(np.zeros((12, 12)) + np.eye(4)[:3].ravel())
        poses[:, 0, 3] = [0, 10, 20, 30, 40, 50, 50, 40, 30, 20, 10, 3]
        lines = [{'frame': frame} for frame in range(12)]
        lines[8:] = [self.line(8, 3), self.line(9, 2, moved=2.0), self.line(10, 1, turned=1.0), self.line(11, 0, moved=3.5)]
        counts, errors = acceptance.judged(lines, poses)
        self.assertEqual(counts, {'possible': 4, 'correct': 2, 'incorrect': 2})
        self.assertEqual([error[0] for error in errors], [0, 0.5])
        self.assertEqual(acceptance.judged(lines, poses, reach=2)[0], {'possible': 3, 'correct': 1, 'impossible': 1, 'incorrect': 2})

    def test_counts_of_laps_by_lists_and_the_time_between_them(self):
        lines = [self.line(2, 3), self.line(3, 9), self.line(4, 4), self.line(5, 9), {'frame': 6}]  # 4 and 5 are not listed
        with tempfile.TemporaryDirectory() as folder, mock.patch.object(acceptance, 'lines_of', lambda *_: lines):
            counts = acceptance.second_lap(Path(folder), {2: [2], 3: [3], 6: []})
            self.assertEqual((counts['possible'], counts['correct'], counts['incorrect']), (2, 1, 1))
            for start, lap in enumerate(('first', 'second')):
                np.savetxt(Path(folder, f'{lap}_times.txt'), np.arange(10) * 2 + 300 * start)
            self.assertEqual(acceptance.second_lap(Path(folder), {2: [2], 3: [3], 6: []})['incorrect'], 2)


if __name__ == '__main__':
    unittest.main()
