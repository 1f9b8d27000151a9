"""ONNX models of the nets of tests/golden/zoo against what the original Caffe computed."""

import unittest

import goldens
from support import GOLDEN

# NaN and infinity: ONNX Runtime's ReLU, Max and MaxPool have rules of their own for them.
NOT_FINITE = {'eltwise_max_special', 'pool_max_all_neginf', 'relu_special'}
# Softmax of ONNX Runtime, and sums that cancel.
TOLERANCE = 1e-5


class Zoo(unittest.TestCase):
    def test_every_case(self):
        cases = sorted(folder for folder in (GOLDEN / 'zoo').iterdir() if folder.is_dir())
        self.assertGreater(len(cases), 100)
        for folder in cases:
            with self.subTest(folder.name):
                caffe, ours = goldens.measure(*goldens.case(folder))
                if folder.name in NOT_FINITE:
                    self.assertEqual(caffe, float('inf'))  # when it agrees, take it off the list
                else:
                    self.assertLess(max(caffe, ours), TOLERANCE)


if __name__ == '__main__':
    unittest.main()
