"""ONNX models of the nets of tests/golden/zoo against outputs of the original Caffe."""

import unittest

import goldens
from support import GOLDEN

# ONNX Runtime's ReLU, Max and MaxPool treat NaN and infinity differently.
NOT_FINITE = {'eltwise_max_special', 'pool_max_all_neginf', 'relu_special'}
# Limit for ONNX Runtime's Softmax, and for sums with cancellation.
TOLERANCE = 1e-5


class Zoo(unittest.TestCase):
    def test_every_case(self):
        cases = sorted(folder for folder in (GOLDEN / 'zoo').iterdir() if folder.is_dir())
        self.assertGreater(len(cases), 100)
        for folder in cases:
            with self.subTest(folder.name):
                caffe, ours = goldens.measure(*goldens.case(folder))
                if folder.name in NOT_FINITE:
                    self.assertEqual(caffe, float('inf'))  # if it agrees, remove it from the list
                else:
                    self.assertLess(max(caffe, ours), TOLERANCE)


if __name__ == '__main__':
    unittest.main()
