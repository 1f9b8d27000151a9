"""revisit.evaluation and the PCA of revisit.recognition, against numpy and `revisit eval`."""

import math
import os
import subprocess
import tempfile
import unittest
from pathlib import Path

import numpy as np

import revisit
from folders import FolderTest
from revisit import datasets, evaluation, recognition
from scans import simulate


def curve_by_hand(scores, correct, positive):
    """Returns (threshold, precision, recall) at every distinct score."""
    points = []
    for threshold in np.unique(scores)[::-1]:
        accepted = scores >= threshold
        tp = np.count_nonzero(accepted & correct)
        points.append((threshold, tp / np.count_nonzero(accepted), tp / np.count_nonzero(positive)))
    return np.array(points)


class OwnScores(unittest.TestCase):
    def setUp(self):
        random = np.random.default_rng(3)
        self.positive = random.random(400) < 0.6
        self.correct = self.positive & (random.random(400) < 0.8)
        self.scores = np.round(random.random(400) + 0.4 * self.correct, 2)  # some are equal
        self.scores[np.argmax(self.scores)] = 2
        self.correct[np.argmax(self.scores)] = self.positive[np.argmax(self.scores)] = True
        self.labels = evaluation.labels(self.scores, self.correct, self.positive)

    def test_give_the_curve(self):
        curve = evaluation.precision_recall(self.labels)
        by_hand = curve_by_hand(self.scores, self.correct, self.positive)
        for column, name in enumerate(('threshold', 'precision', 'recall')):
            np.testing.assert_allclose(curve[name], by_hand[:, column], rtol=1e-12)
        self.assertTrue((curve['tp'] + curve['fn'] == np.count_nonzero(self.positive)).all())
        np.testing.assert_array_equal(curve['tp'] + curve['fp'], [(self.scores >= t).sum() for t in curve['threshold']])

    def test_give_the_figures(self):
        found = evaluation.summarize(self.labels)
        _, precision, recall = curve_by_hand(self.scores, self.correct, self.positive).T
        self.assertAlmostEqual(found.average_precision, float(np.sum(np.diff(recall, prepend=0) * precision)), places=12)
        self.assertAlmostEqual(found.f1_max, float(np.max(2 * precision * recall / (precision + recall))), places=12)
        self.assertAlmostEqual(found.max_recall_at_precision_1, float(recall[precision == 1].max()), places=12)
        self.assertAlmostEqual(found.recall_at_1, self.correct.sum() / self.positive.sum(), places=12)
        self.assertEqual((found.n_queries, found.n_positives), (400, self.positive.sum()))

    def test_give_intervals(self):
        found = evaluation.summarize(self.labels)
        intervals = evaluation.bootstrap(self.labels, blocks=1, resamples=300)
        random = np.random.default_rng(4)
        drawn = []
        for _ in range(300):
            rows = random.integers(0, 400, 400)
            drawn.append(self.correct[rows].sum() / self.positive[rows].sum())
        np.testing.assert_allclose(intervals.recall_at_1, np.quantile(drawn, [0.025, 0.975]), atol=0.015)
        low, high = intervals.average_precision
        self.assertLess(low, found.average_precision)
        self.assertGreater(high, found.average_precision)
        self.assertEqual(intervals.f1_max, evaluation.bootstrap(self.labels, blocks=1, resamples=300, threads=2).f1_max)

    def test_blocks_are_drawn_whole(self):
        by_number, by_hand = (evaluation.bootstrap(self.labels, blocks=blocks, resamples=300)
                              for blocks in (40, [i // 40 for i in range(400)]))
        self.assertEqual(by_number.recall_at_1, by_hand.recall_at_1)
        self.assertTrue(np.isnan(evaluation.bootstrap(self.labels, blocks=400).recall_at_1).all())
        with self.assertRaisesRegex(revisit.UsageError, 'block of each of 400 queries, found 2'):
            evaluation.bootstrap(self.labels, blocks=[1, 2])

    def test_are_checked(self):
        with self.assertRaisesRegex(ValueError, 'one per query'):
            evaluation.labels([1, 2], [True])
        with self.assertRaisesRegex(TypeError, 'expected bool'):
            evaluation.labels([1, 2], [1, 0])
        with self.assertRaisesRegex(TypeError, 'masked'):
            evaluation.labels(np.ma.masked_array([1.0, 2], [True, False]), [True, False])
        with self.assertRaises(revisit.Error):
            evaluation.summarize(evaluation.labels([float('nan')], [True]))
        with self.assertRaises(revisit.UsageError):
            evaluation.summarize([], missed='often')
        self.assertTrue(math.isnan(evaluation.summarize([]).average_precision))


class Drives(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        folder = tempfile.TemporaryDirectory()
        cls.addClassCleanup(folder.cleanup)
        cls.folder = Path(folder.name)
        simulate(cls.folder, length=400, every=8, route='both', sensor='vlp16')
        cls.dataset = datasets.open_dataset(cls.folder, poses=True)
        cls.trajectory = evaluation.make_trajectory(cls.dataset)
        describe = recognition.from_scan(recognition.m2dp_features())
        cls.descriptors = np.stack([describe(datasets.read_scan(scan.file)) for scan in cls.dataset.scans])

    def task(self):
        task, = evaluation.make_tasks('online', '', self.trajectory, 'frames=100')
        return task

    def test_positives_are_those_of_the_program(self):
        if 'REVISIT_PROGRAM' not in os.environ:
            self.skipTest('REVISIT_PROGRAM is not set')
        out = subprocess.run([os.environ['REVISIT_PROGRAM'], 'eval', self.folder, '--exclusion', 'frames=100', '--ground-truth',
                              self.folder / 'truth.csv'], check=True, capture_output=True, text=True).stdout
        task = self.task()
        any_match = [evaluation.Match(row, task.candidates(number)[:1], 0) for number, row in enumerate(task.queries)]
        figures = evaluation.evaluate(task, self.trajectory, matches=any_match, resamples=0).summary
        self.assertTrue(out.startswith(f'{figures.n_positives} of {figures.n_queries} queries have a correct match'), out)
        self.assertGreater(figures.n_positives, 5)

    def test_descriptors_are_judged_as_numpy_judges_them(self):
        task, at = self.task(), np.array([scan.pose[:3, 3] for scan in self.dataset.scans])
        result = evaluation.evaluate(task, self.trajectory, descriptors=self.descriptors, score='similarity', resamples=50)
        unit = self.descriptors.astype(np.float64)
        unit /= np.linalg.norm(unit, axis=1, keepdims=True)
        for number, (row, match, label) in enumerate(zip(task.queries, result.matches, result.labels)):
            candidates = np.array(task.candidates(number))
            self.assertTrue(all(self.trajectory.frames[row] - self.trajectory.frames[c] > 100 for c in candidates))
            similarities = unit[candidates] @ unit[row]
            self.assertAlmostEqual(match.score, similarities.max(), places=6)
            apart = np.linalg.norm((at[candidates] - at[row])[:, [0, 2]], axis=1)
            self.assertEqual(label.positive, bool((apart < task.radius).any()))
            self.assertEqual(label.correct, bool(apart[list(candidates).index(match.ranks[0])] < task.radius))
        self.assertIsNotNone(result.intervals)

    def test_own_matches_are_judged(self):
        task, at = self.task(), np.array([scan.pose[:3, 3] for scan in self.dataset.scans])
        nearest = []
        for number, row in enumerate(task.queries):
            apart = {c: np.linalg.norm((at[c] - at[row])[[0, 2]]) for c in task.candidates(number)}
            best = min(apart, key=apart.get)
            nearest.append(evaluation.Match(row, [best], -apart[best]))
        figures = evaluation.evaluate(task, self.trajectory, matches=nearest).summary
        self.assertEqual((figures.average_precision, figures.recall_at_1), (1, 1))
        wrong = [evaluation.Match(m.query, [m.query], 1) for m in nearest]
        with self.assertRaisesRegex(revisit.Error, 'no candidate'):
            evaluation.evaluate(task, self.trajectory, matches=wrong)
        with self.assertRaisesRegex(ValueError, 'exactly one of descriptors and matches'):
            evaluation.evaluate(task, self.trajectory)

    def test_pairs_are_decided_on(self):
        names = [protocol.name for protocol in evaluation.protocols()]
        self.assertIn('ssc', names)
        task, = evaluation.make_tasks('ssc', '', self.trajectory)
        self.assertTrue(task.decides_on_pairs)
        result = evaluation.evaluate(task, self.trajectory, descriptors=self.descriptors, resamples=20)
        self.assertGreater(result.summary.n_correct_pairs, 0)
        self.assertEqual(len(result.curve['recall']), len(result.curve['precision']))

    def test_listed_pairs_are_the_truth(self):
        task, at = self.task(), np.array([scan.pose[:3, 3] for scan in self.dataset.scans])
        frames = self.trajectory.frames
        with open(self.folder / 'pairs.csv', 'w') as file:
            for number, row in enumerate(task.queries):
                near = [c for c in task.candidates(number) if np.linalg.norm((at[c] - at[row])[[0, 2]]) < task.radius]
                file.write(''.join(f'{frames[row]},{frames[c]}\n' for c in near))
        pairs = evaluation.read_pairs(self.folder / 'pairs.csv', self.dataset)
        trajectory = evaluation.make_trajectory(self.dataset)
        by_poses = evaluation.evaluate(task, trajectory, descriptors=self.descriptors, block='frames=40')
        trajectory.listed = evaluation.ListedPairs(pairs, complete=True)
        listed, = evaluation.make_tasks('online', '', trajectory, 'frames=100')
        by_list = evaluation.evaluate(listed, trajectory, descriptors=self.descriptors, block='frames=40')
        self.assertEqual(listed.distance, 'pairs')
        self.assertEqual(by_list.summary.average_precision, by_poses.summary.average_precision)
        self.assertEqual(by_list.intervals.f1_max, by_poses.intervals.f1_max)
        trajectory.listed = evaluation.ListedPairs(pairs)
        known, = evaluation.make_tasks('online', '', trajectory, 'frames=100')
        self.assertEqual([frames[row] for row in known.queries], sorted(pairs))
        self.assertEqual(evaluation.blocks_of(known, trajectory, 'frames=40'), [frames[row] // 40 for row in known.queries])

    def test_a_trajectory_of_arrays_is_the_same(self):
        positions = np.array([scan.pose[:3, 3] for scan in self.dataset.scans])
        trajectory = evaluation.Trajectory(self.trajectory.frames, positions, camera_axes=True)
        of_arrays, = evaluation.make_tasks('online', '', trajectory, 'frames=100')
        self.assertEqual((of_arrays.queries, of_arrays.distance), (self.task().queries, 'xz'))
        z_up, = evaluation.make_tasks('online', '', evaluation.Trajectory(self.trajectory.frames, positions), 'frames=100')
        self.assertEqual(z_up.distance, 'xy')
        with self.assertRaisesRegex(TypeError, 'float64'):
            evaluation.Trajectory([0, 1], positions.astype(np.float32)[:2])
        with self.assertRaisesRegex(ValueError, 'one per frame'):
            evaluation.Trajectory([0, 1], positions[:3])
        with self.assertRaises(revisit.InputError):
            evaluation.Trajectory([1, 0], positions[:2])


class Pca(FolderTest):
    def setUp(self):
        random = np.random.default_rng(5)
        self.x = (random.normal(size=(40, 6)) * [9, 7, 5, 3, 2, 1] @ random.normal(size=(6, 300)) + 2).astype(np.float32)
        super().setUp()

    def by_numpy(self, rows, components):
        mean = self.x[rows].mean(axis=0, dtype=np.float64)
        _, s, directions = np.linalg.svd(self.x[rows] - mean, full_matrices=False)
        return (self.x - mean) @ directions[:components].T, s[:components] ** 2 / (len(rows) - 1)

    def test_is_that_of_numpy(self):
        rows = list(range(0, 40, 2))
        found = recognition.fit_pca(self.x, 4, fit_rows=rows, model_folder=self.folder / 'pca')
        wanted, variances = self.by_numpy(rows, 4)
        self.assertEqual((found.rank, found.note), (4, ''))
        signs = np.sign((found.descriptors * wanted).sum(axis=0))
        np.testing.assert_allclose(found.descriptors, wanted * signs, atol=2e-3)
        np.testing.assert_allclose(found.variances, variances, rtol=1e-4)
        mean, basis = (np.load(self.folder / 'pca' / f'{name}.npy') for name in ('mean', 'basis'))
        np.testing.assert_allclose((self.x - mean) @ basis.T, found.descriptors, atol=2e-3)
        np.save(self.folder / 'x.npy', self.x)
        parts = [self.folder / 'x.npy', self.x[:1]]
        np.testing.assert_array_equal(recognition.fit_pca(parts, 2).descriptors,
                                      recognition.fit_pca(np.concatenate([self.x, self.x[:1]]), 2).descriptors)

    def test_is_checked(self):
        self.assertIn('5', recognition.fit_pca(self.x[:6], 400).note)
        with self.assertRaisesRegex(TypeError, 'float64 array'):
            recognition.fit_pca(self.x.astype(np.float64))
        with self.assertRaisesRegex(TypeError, 'masked array'):
            recognition.fit_pca(np.ma.masked_array(self.x, self.x > 1))
        with self.assertRaises(revisit.InputError):
            recognition.fit_pca(np.full((3, 4), np.nan, np.float32))
        with self.assertRaises(revisit.UsageError):
            recognition.fit_pca(self.x, 0)
        for memory in (0, -1, math.inf, math.nan):
            with self.assertRaisesRegex(revisit.UsageError, 'memory_gb'):
                recognition.fit_pca(self.x, 4, memory_gb=memory)
        self.assertEqual(recognition.fit_pca(self.x, 4, memory_gb=1e12).rank, 4)


if __name__ == '__main__':
    unittest.main()
