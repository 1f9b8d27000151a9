"""revisit.registration: accuracy of relative poses, and consistency of the information matrix."""

import os
import tempfile
import unittest
from pathlib import Path

import numpy as np

from pairs import WITHOUT_HEIGHT, as_they_are, normalized_squares, pairs_of, real_pairs, registered
from revisit import UsageError, registration
from scans import room, simulate

NCLT = Path(os.environ.get('REVISIT_TEST_DATA', Path(__file__).resolve().parents[3] / 'shared')) / 'real/nclt'


class Registering(unittest.TestCase):
    def test_finds_the_turn_and_shift(self):
        place = registration.PreparedScan(room(1))
        query = registration.PreparedScan(room(1, turn=0.5))
        self.assertGreater(len(place), 1000)
        self.assertEqual(place.points.shape, (len(place), 3))
        self.assertEqual(place.normals.shape, (len(place), 3))
        found = registration.register_scans(query, place, 0.48)
        turn = np.arctan2(found.T_place_query[1, 0], found.T_place_query[0, 0])
        self.assertAlmostEqual(turn, 0.5, delta=0.01)
        np.testing.assert_allclose(found.T_place_query[:3, 3], 0, atol=0.2)
        self.assertGreater(found.inlier_ratio, 0.5)
        self.assertEqual(found.information.shape, (6, 6))

    def test_takes_points_in_the_place_of_prepared_scans(self):
        options = registration.RegistrationOptions(voxel_size=0.3)
        query, place = room(1, turn=0.5), room(1)
        expected = registration.register_scans(registration.PreparedScan(query, options), registration.PreparedScan(place, options),
                                               0.48, options)
        for one in (query, tuple(np.ascontiguousarray(axis) for axis in query.T[:3])):
            found = registration.register_scans(one, registration.PreparedScan(place, options), 0.48, options)
            np.testing.assert_array_equal(found.T_place_query, expected.T_place_query)
        found = registration.register_scans(query, place, options=options, relative_yaw=0.48)
        np.testing.assert_array_equal(found.information, expected.information)
        for wrong in (None, 'points', np.zeros((3, 2), np.float32)):
            with self.assertRaises((TypeError, ValueError)):
                registration.register_scans(wrong, place, 0)

    def test_rejects_invalid_arguments(self):
        with self.assertRaisesRegex(UsageError, 'voxel'):
            registration.PreparedScan(room(1), registration.RegistrationOptions(voxel_size=0))
        scan = registration.PreparedScan(room(1))
        with self.assertRaisesRegex(UsageError, 'finite relative yaw'):
            registration.register_scans(scan, scan, np.nan)

    def test_a_scan_of_few_points_never_fits(self):
        few = registration.PreparedScan(np.ones((3, 3), np.float32))
        self.assertFalse(registration.register_scans(few, few, 0).fits)


class OfASimulatedDrive(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        folder = tempfile.TemporaryDirectory()
        cls.addClassCleanup(folder.cleanup)
        drive = Path(folder.name) / 'town'
        simulate(drive, length=400, every=8, route='both', seed=31)
        cls.pairs = pairs_of(drive, 50)
        cls.found = list(registered(cls.pairs))

    def test_information_is_consistent(self):
        """The NEES of consistent estimates has mean 6, within 1 for 50 pairs. docs/RESULTS.md has more."""
        squares = normalized_squares(self.found)
        self.assertEqual(len(self.pairs), 50)
        self.assertGreater(len(squares), 45)
        self.assertGreater(squares.mean(), 3)
        self.assertLess(squares.mean(), 12)


@unittest.skipUnless(NCLT.exists(), f'no {NCLT}; REVISIT_TEST_DATA names the folder of test data')
class OfARealDrive(unittest.TestCase):
    def test_information_is_honest(self):
        """Heights of NCLT's ground truth differ between visits, so revisits are judged without them. docs/RESULTS.md has all pairs."""
        pairs = real_pairs(NCLT / 'bin', NCLT / 'poses_kitti.txt', 120)
        for name, dof in ('consecutive', slice(6)), ('revisits', WITHOUT_HEIGHT):
            squares = normalized_squares(list(registered(pairs[name], prepare=as_they_are)), dof)
            self.assertGreater(len(squares), 40)
            self.assertLess(squares.mean(), 20)


if __name__ == '__main__':
    unittest.main()
