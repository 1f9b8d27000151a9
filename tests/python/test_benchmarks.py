"""Tests of bench, whose metrics are in docs/RESULTS.md."""

import json
import sys
import tempfile
import unittest
from pathlib import Path
from unittest import mock

import numpy as np
from revisit import recognition
from scans import room

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / 'bench'))
import discriminants  # noqa: E402
import drives  # noqa: E402
import real_drives  # noqa: E402
import tables  # noqa: E402


def there_and_back(length=200, step=2, beside=1):
    """A street in both directions, z up: place k of the first direction is next to place 2 n - 1 - k."""
    x = np.arange(0, length, step, float)
    at = np.r_[np.c_[x, 0 * x], np.c_[x[::-1], 0 * x + beside]]
    poses = np.tile(np.eye(4), (len(at), 1, 1))
    poses[:, :2, 3] = at
    return drives.DriveWithPoses('street', [f'{i}' for i in range(len(at))], poses)


class Drives(unittest.TestCase):
    def test_recent_places_are_no_candidates(self):
        drive = there_and_back()
        self.assertEqual(list(drive.candidates[:27]), [0] * 26 + [1])  # 50 m are 25 keyframes
        self.assertIs(drive.has_place(50), False)
        self.assertIs(drive.has_place(199), True)

    def test_figures_by_hand(self):
        drive = there_and_back()
        # Correct, correct, 8 m off (ignored), incorrect, no answer; then a query without a place, with a low score.
        answers = [(199, 0, 5, True), (198, 1, 4, False), (197, 6, 3, True), (196, 60, 2, True), (195, None, 0, False), (60, 0, 1, False)]
        found = drives.figures(drive, answers)
        self.assertEqual((found['queries'], found['with_place']), (6, 5))
        self.assertAlmostEqual(found['recall_at_1'], 2 / 5)
        self.assertAlmostEqual(found['ap'], 2 / 4)  # two of four positives are found before the first incorrect match
        self.assertAlmostEqual(found['recall_at_precision_1'], 2 / 4)
        self.assertEqual((found['accepted_correct'], found['accepted_incorrect']), (1, 1))

    def test_keyframes_lie_so_far_from_the_one_before(self):
        drive = there_and_back(length=20, step=2, beside=1).keyframes(3)
        self.assertEqual([file.name for file in drive.files], ['0', '2', '4', '6', '8', '13', '15', '17', '19'])
        self.assertEqual(len(drive.poses), 9)

    def test_the_interval_resamples_blocks(self):
        drive = there_and_back(length=1000)
        alternating = [(q, 999 - q, q, None) if q % 2 else (q, 60, q, None) for q in range(600, 1000)]
        by_block = [(q, 999 - q, q, None) if q // 100 % 2 else (q, 60, q, None) for q in range(600, 1000)]
        widths = []
        for answers in (alternating, by_block):
            found = drives.figures(drive, answers)
            low, high = found['ap_interval']
            self.assertTrue(low <= found['ap'] <= high)
            widths.append(high - low)
        self.assertGreater(widths[1], 2 * widths[0])

    def test_listed_pairs(self):
        with tempfile.TemporaryDirectory() as folder:
            for lap in ('first', 'second'):
                Path(folder, lap).mkdir()
                for i in range(6):
                    Path(folder, lap, f'{i:06}.bin').touch()
            Path(folder, 'loops.csv').write_text('query,place\nsecond/000004,first/000001\n')
            with mock.patch.dict(drives.TwoLaps.CERTAIN, {Path(folder).name: 2}):
                drive = drives.TwoLaps(Path(folder))
        self.assertEqual(list(drive.candidates), [0] * 6 + [6] * 6)
        self.assertEqual([drive.has_place(i) for i in range(6, 12)], [False, False, None, None, True, None])
        self.assertEqual([drive.is_correct(10, i) for i in range(6)], [True, True, True, True, False, False])


class Discriminants(unittest.TestCase):
    def test_a_turned_context_is_the_same(self):
        describe = recognition.from_scan(recognition.scan_context_features())
        contexts = np.array([describe(points) for points in (room(1), room(2), room(1, turn=np.radians(90)))])
        directions = [np.eye(20)] * discriminants.FREQUENCIES
        numbers = discriminants.descriptors('scan-context', contexts, 0, directions)
        to_room, to_other = discriminants.similarities(numbers, 2, 2)
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

    def test_principal_components_of_wide_rows(self):
        rows = np.random.default_rng(1).normal(size=(20, 40000)).astype(np.float32) + 5
        u, s, _ = np.linalg.svd(rows - rows.mean(0), full_matrices=False)
        np.testing.assert_allclose(np.abs(real_drives.principal_components(rows, 10)), np.abs(u * s)[:, :10], atol=0.01)


class Tables(unittest.TestCase):
    def test_a_row_takes_the_place_of_its_older_one_and_of_none_else(self):
        with tempfile.TemporaryDirectory() as folder, mock.patch.object(tables, 'DATA', Path(folder)):
            file = Path(folder, 'rows.json')
            for ap in (0.5, 0.25):
                for name in ('a', 'b'):
                    real_drives.keep(file, {'drive': 'd', 'name': name, 'ap': ap})
            self.assertEqual(len(json.loads(file.read_text())), 2)
            page = ['text', '<!-- table: rows.json columns=ap,accepted_incorrect -->', '| old |', 'more']
            (begin, end, right), = tables.tables_in(page)
        self.assertEqual((begin, end), (2, 3))
        self.assertEqual(right[2:], ['| d | a | 0.250 | - |', '| d | b | 0.250 | - |'])

    def test_perturbations_stand_side_by_side(self):
        with tempfile.TemporaryDirectory() as folder, mock.patch.object(tables, 'DATA', Path(folder)):
            for name, perturbation, ap in (('a', 'none', 1.0), ('b', 'none', 0.5), ('a', 'turn', 0.25)):
                real_drives.keep(Path(folder, 'perturbed.json'), {'drive': 'd', 'name': name, 'perturbation': perturbation, 'ap': ap})
            (_, _, right), = tables.tables_in(['<!-- table: perturbed.json drive=d columns=ap -->'])
        self.assertEqual(right, ['| perturbation | d, a: AP | d, b: AP |', '|---|---|---|', '| none | 1.000 | 0.500 |', '| turn | 0.250 | - |'])

    def test_towns_have_their_mean_and_the_lowest(self):
        with tempfile.TemporaryDirectory() as folder, mock.patch.object(tables, 'DATA', Path(folder)):
            for town, ap, keyframes in ((11, 0.5, 1.0), (12, 0.75, 1.0), (13, 0.1, None)):
                row = {'drive': f'town{town}-08-ouster-os1-64', 'name': 'a', 'ap': ap, 'ap_interval': [ap - 0.1, 1], 'with_place': 3, 'accepted_correct': 2, 'accepted_incorrect': 1}
                real_drives.keep(Path(folder, 'towns.json'), row | ({'keyframes': keyframes} if keyframes else {}))
            real_drives.keep(Path(folder, 'towns.json'), {'drive': 'town:11', 'name': 'a', 'ap': 1.0, 'keyframes': 1.0})
            (_, _, right), = tables.tables_in(['<!-- table: towns.json keyframes=1.0 routes=08,06 -->'])
        self.assertEqual(right[2:], ['| ouster-os1-64 | a | 0.625 (2) | - | 0.500 | 0.400 to 1 | 4 of 6 | 2 |'])


if __name__ == '__main__':
    unittest.main()
