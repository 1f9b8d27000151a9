"""Layers written in Python in nets of revisit.caffe."""

import sys
import types
import unittest

import caffe_needs  # noqa: F401
import numpy as np

import revisit
import revisit.caffe as caffe
from folders import FolderTest

# x -> 2 x -> rows with a positive sum, times param_str -> inner product.
NET = """
layer { name: "data" type: "Input" top: "data" input_param { shape { dim: 3 dim: 2 } } }
layer { name: "double" type: "Power" bottom: "data" top: "double" power_param { scale: 2 } }
layer { name: "choose" type: "Python" bottom: "double" top: "chosen"
        python_param { module: "test_caffe_layers_module" layer: "Choose" param_str: "{'factor': 10}" } }
layer { name: "fc" type: "InnerProduct" bottom: "chosen" top: "fc"
        inner_product_param { num_output: 4 weight_filler { type: "gaussian" } bias_filler { value: 3 } } }
layer { name: "relu" type: "ReLU" bottom: "fc" top: "fc" }
"""
X = np.array([[1, 2], [-3, 1], [4, -1]], np.float32)


class Choose(caffe.Layer):
    def setup(self, bottom, top):
        self.factor = eval(self.param_str)['factor']
        self.phases = self.phase

    def reshape(self, bottom, top):
        top[0].reshape(1, bottom[0].shape[1])

    def forward(self, bottom, top):
        rows = bottom[0].data[bottom[0].data.sum(axis=1) > 0]
        top[0].reshape(*rows.shape)
        top[0].data[...] = rows * self.factor

    def backward(self, top, propagate_down, bottom):
        raise AssertionError('nobody trains')


class Layers(FolderTest):
    def setUp(self):
        module = types.ModuleType('test_caffe_layers_module')
        module.Choose, module.NoLayer, module.__file__ = Choose, dict, 'module.py'
        sys.modules[module.__name__] = module
        self.addCleanup(sys.modules.pop, module.__name__)
        super().setUp()

    def net(self, text=NET, **options):
        (self.folder / 'net.prototxt').write_text(text)
        return caffe.Net(str(self.folder / 'net.prototxt'), caffe.TEST, **options)

    def expected(self, net, x):
        chosen = 20 * x[x.sum(axis=1) > 0]
        weights, bias = (blob.data for blob in net.params['fc'])
        return chosen, np.maximum(chosen @ weights.T + bias, 0)

    def check(self, net, x=X):
        net.blobs['data'].reshape(*x.shape)
        out = net.forward(data=x)
        chosen, fc = self.expected(net, x)
        np.testing.assert_allclose(net.blobs['chosen'].data, chosen)
        np.testing.assert_allclose(out['fc'], fc, rtol=1e-5)

    def test_run_in_their_place(self):
        net = self.net()
        self.assertEqual([layer.type for layer in net.layers][2], 'Python')
        self.assertEqual([net.blobs[name].shape for name in ('chosen', 'fc')], [[1, 2], [1, 4]])
        self.check(net)
        self.check(net, np.ones((5, 2), np.float32))
        net.params['fc'][0].data[...] = 2
        self.check(net)
        phase = net.layers[2].script.phases
        self.assertEqual(phase, caffe.TEST)
        # str() as in the fork of Faster R-CNN.
        self.assertEqual((str(phase), f'{phase}', '%d' % phase, {1: 'one'}[phase]), ('TEST', 'TEST', '1', 'one'))

    def test_a_proposal_layer_of_the_user_runs(self):
        """Commands read such a layer as a Proposal of the engine."""
        class ProposalLayer(caffe.Layer):
            def setup(self, bottom, top):
                top[0].reshape(1, 5)

            def forward(self, bottom, top):
                top[0].reshape(2, 5)
                top[0].data[...] = 7

        for name in ('rpn', 'rpn.proposal_layer'):
            sys.modules[name] = types.ModuleType(name)
            self.addCleanup(sys.modules.pop, name)
        sys.modules['rpn.proposal_layer'].ProposalLayer = ProposalLayer
        text = """
layer { name: "in" type: "Input" top: "s" top: "o" top: "i" input_param {
        shape { dim: 1 dim: 18 dim: 2 dim: 2 } shape { dim: 1 dim: 36 dim: 2 dim: 2 } shape { dim: 1 dim: 3 } } }
layer { name: "p" type: "Python" bottom: "s" bottom: "o" bottom: "i" top: "rois"
        python_param { module: "rpn.proposal_layer" layer: "ProposalLayer" param_str: "'feat_stride': 16" } }
layer { name: "double" type: "Power" bottom: "rois" top: "double" power_param { scale: 2 } }
"""
        net = self.net(text)
        self.assertEqual(net.layers[1].type, 'Python')
        np.testing.assert_array_equal(net.forward()['double'], np.full((2, 5), 14))
        staged = caffe.Net(str(self.folder / 'net.prototxt'), caffe.TEST, stages=['any'])
        np.testing.assert_array_equal(staged.forward()['double'], np.full((2, 5), 14))
        self.assertEqual(dict(revisit.proto.read_net(self.folder / 'net.prototxt').layers)['p'], 'Proposal')

    def test_weights_are_saved_and_read(self):
        net = self.net()
        net.save(str(self.folder / 'saved.caffemodel'))
        again = self.net(weights=str(self.folder / 'saved.caffemodel'))
        np.testing.assert_array_equal(again.params['fc'][0].data, net.params['fc'][0].data)
        self.check(again)

    def test_parts_of_the_net(self):
        net = self.net()
        net.blobs['data'].data[...] = X
        net.forward(end='double')
        np.testing.assert_array_equal(net.blobs['double'].data, 2 * X)
        self.assertFalse(net.blobs['chosen'].data.any())
        net.forward(start='choose')
        np.testing.assert_allclose(net.blobs['fc'].data, self.expected(net, X)[1], rtol=1e-5)

    def test_a_net_of_them_only(self):
        only = NET[NET.index('layer { name: "choose"') : NET.index('layer { name: "fc"')]
        dummy = 'layer { name: "d" type: "DummyData" top: "double" dummy_data_param { shape { dim: 2 dim: 3 } } }'
        net = self.net(dummy + only)
        net.blobs['double'].data[...] = [[1, 2, 3], [-1, 0, 0]]
        np.testing.assert_array_equal(net.forward()['chosen'], [[10, 20, 30]])

    def test_dummy_data(self):
        net = self.net(
            """
layer { name: "made" type: "DummyData" top: "noise" top: "three"
        dummy_data_param { shape { dim: 50 dim: 20 } shape { dim: 2 }
                           data_filler { type: "uniform" min: 5 max: 6 } data_filler { value: 3 } } }
layer { name: "old" type: "DummyData" top: "zero" dummy_data_param { num: 1 channels: 2 height: 3 width: 4 } }
layer { name: "double" type: "Power" bottom: "noise" top: "double" power_param { scale: 2 } }
"""
        )
        self.assertEqual(net.blobs['zero'].shape, [1, 2, 3, 4])
        self.assertEqual(net.inputs, [])
        first = net.forward()['double'].copy()
        self.assertTrue(10 <= first.min() < first.max() <= 12)
        np.testing.assert_array_equal(net.blobs['three'].data, [3, 3])
        net.blobs['three'].data[...] = 7  # persists, as in Caffe
        self.assertTrue((net.forward()['double'] != first).any())
        np.testing.assert_array_equal(net.blobs['three'].data, [7, 7])
        net.blobs['noise'].reshape(3, 2)  # another shape persists, too
        self.assertEqual(net.forward()['double'].shape, (3, 2))
        for wrong in (
            'shape { dim: 1 } shape { dim: 2 }',
            'num: 1',
            'shape { dim: 1 } data_filler { type: "odd" }',
        ):
            text = 'layer { name: "a" type: "DummyData" top: "a" dummy_data_param { %s } }' % wrong
            with self.assertRaises(revisit.InputError, msg=wrong):
                self.net(text).forward()

    def test_mistakes(self):
        for found, wanted in (
            ('test_caffe_layers_module', 'no_such_module'),
            ('Choose"', 'NoLayer"'),
        ):
            with self.assertRaisesRegex(revisit.InputError, "layer 'choose'"):
                self.net(NET.replace(found, wanted))


if __name__ == '__main__':
    unittest.main()
