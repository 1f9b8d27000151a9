"""revisit.registration, where the build has it."""

import unittest

import numpy as np

from scans import room

try:
    from revisit import registration
except ImportError:
    registration = None


@unittest.skipIf(registration is None, 'a build without PCL')
class Registering(unittest.TestCase):
    def test_finds_the_turn_and_shift(self):
        place = registration.PreparedScan(room(1))
        query = registration.PreparedScan(room(1, turn=0.5))
        self.assertGreater(len(place), 1000)
        found = registration.register_scans(query, place, 0.48)
        turn = np.arctan2(found.T_place_query[1, 0], found.T_place_query[0, 0])
        self.assertAlmostEqual(turn, 0.5, delta=0.01)
        np.testing.assert_allclose(found.T_place_query[:3, 3], 0, atol=0.2)
        self.assertGreater(found.inliers, 0.5)
        self.assertEqual(found.information.shape, (6, 6))


if __name__ == '__main__':
    unittest.main()
