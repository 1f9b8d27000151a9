"""caffe.coord_map: coordinate maps between outputs of a NetSpec, against values computed by hand."""

import unittest

import caffe_needs  # noqa: F401
import numpy as np

from revisit.caffe import NetSpec
from revisit.caffe import layers as L
from revisit.caffe.coord_map import coord_map_from_to, crop


def image(size=64):
    return L.Input(shape=dict(dim=[1, 3, size, size]))


def fcn(data, pad=100):
    """Pixel x of the input is at 2 * (0.5 * (x + pad - 1) - 0.25) + 1.5 = x + pad of the output."""
    conv = L.ReLU(L.Convolution(data, num_output=2, kernel_size=3, pad=pad), in_place=True)
    pool = L.Pooling(conv, kernel_size=2, stride=2)
    return L.Deconvolution(pool, convolution_param=dict(num_output=2, kernel_size=4, stride=2))


class CoordMap(unittest.TestCase):
    def check(self, found, axis, scale, shift):
        self.assertEqual(found[0], axis)
        np.testing.assert_allclose(found[1], scale)
        np.testing.assert_allclose(found[2], shift)

    def test_of_a_net_that_reads_images(self):
        data = image()
        self.check(coord_map_from_to(fcn(data), data), 1, 1, -100)
        self.check(coord_map_from_to(data, fcn(data)), 1, 1, 100)

    def test_of_two_branches(self):
        data = image()
        down = L.Pooling(data, kernel_size=3, stride=2)  # x -> x / 2 - 0.5
        self.check(coord_map_from_to(down, fcn(data)), 1, 2, 101)

    def test_dilation_and_axes(self):
        data = image()
        conv = L.Convolution(data, num_output=1, kernel_size=[3, 5], dilation=2, stride=[1, 4], pad=[0, 4])
        self.check(coord_map_from_to(data, conv), 1, [1, 0.25], [-2, 0])

    def test_crop(self):
        net = NetSpec()
        net.data = image()
        net.up = fcn(net.data)
        net.score = crop(net.up, net.data)
        layer = net.to_proto().layer[-1]
        self.assertEqual((layer.type, list(layer.bottom)), ('Crop', ['up', 'data']))
        self.assertEqual((layer.crop_param.axis, list(layer.crop_param.offset)), (2, [100]))
        # A crop of a crop starts where the first does.
        self.check(coord_map_from_to(net.score, net.data), 1, 1, 0)

    def test_refuses(self):
        data = image()
        with self.assertRaisesRegex(AssertionError, 'scale mismatch'):
            crop(L.Pooling(data, kernel_size=2, stride=2), data)
        with self.assertRaisesRegex(AssertionError, 'negative offset'):
            crop(data, fcn(data))
        with self.assertRaisesRegex(AssertionError, 'noninteger'):
            crop(L.Convolution(data, num_output=1, kernel_size=4, pad=4), data)
        with self.assertRaisesRegex(AssertionError, 'legacy'):
            crop(L.Convolution(data, num_output=1, kernel_size=3, pad_h=4, pad_w=3), data)
        with self.assertRaisesRegex(RuntimeError, 'connected'):
            coord_map_from_to(L.InnerProduct(data, num_output=1), data)


if __name__ == '__main__':
    unittest.main()
