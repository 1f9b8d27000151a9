"""A fixed range of random nets in ONNX Runtime; tests/random_nets/onnx_oracle.py tests more."""

import os
import sys
import unittest

from support import ROOT

sys.path.insert(0, str(ROOT / 'tests' / 'random_nets'))
import onnx_oracle  # noqa: E402

PROGRAM = os.environ.get('REVISIT_RANDOM_NETS')
NETS = 50
REFUSED = (
    '(SoftmaxWithLoss|EuclideanLoss|Accuracy|ContinuationIndicator|CTCGreedyDecoder|DecodeBBox|Proposal|PSROIContextPooling|PSROIPooling|ROIAlign|[a-z0-9A-Z]*Output): this type cannot be exported'
    '|(Convolution|ConvolutionDepthwise|Im2col): expected a kernel of at most|export with --fixed|Dropout: random numbers at inference|pad_ratio is not supported|pooling of volumes')


@unittest.skipUnless(PROGRAM, 'REVISIT_RANDOM_NETS does not name the program revisit_random_nets')
class RandomNets(unittest.TestCase):
    def test_fixed_seeds(self):
        statistics = onnx_oracle.Statistics()
        onnx_oracle.check(PROGRAM, 100, NETS, 10, statistics)
        self.assertEqual(statistics.faults, 0)
        self.assertEqual(statistics.nets, NETS)
        for kind, why in statistics.refused:
            self.assertRegex(f'{kind}: {why}', REFUSED)
        self.assertLess(statistics.insensitive, statistics.outputs / 10, 'tolerances that find nothing')
        self.assertLess(statistics.too_large, statistics.nets / 10, 'nets that compare no numbers')


if __name__ == '__main__':
    unittest.main()
