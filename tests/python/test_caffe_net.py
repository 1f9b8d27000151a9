"""revisit.caffe.Net: pycaffe's behavior, on nets computed by hand."""

import gc
import itertools
import os
import unittest
import warnings
import weakref
from pathlib import Path

import numpy as np

import caffe_needs  # noqa: F401  exits without protobuf

import revisit
import revisit.caffe as caffe
from folders import FolderTest
from google.protobuf import text_format

# x -> 2 x, in place max(x, 0), + 10; and a parallel copy of this chain.
CHAIN = """
name: "chain"
layer { name: "data" type: "Input" top: "data" input_param { shape { dim: 2 dim: 3 } } }
layer { name: "double" type: "Power" bottom: "data" top: "double" power_param { scale: 2 } }
layer { name: "relu" type: "ReLU" bottom: "double" top: "double" }
layer { name: "plus" type: "Power" bottom: "double" top: "plus" power_param { shift: 10 } }
layer { name: "minus" type: "Power" bottom: "double" top: "minus" power_param { shift: -10 } }
layer { name: "sum" type: "Eltwise" bottom: "plus" bottom: "minus" top: "sum" }
"""

WEIGHTED = """
name: "weighted"
layer { name: "data" type: "Input" top: "data" input_param { shape { dim: 1 dim: 2 dim: 4 dim: 4 } } }
layer { name: "conv" type: "Convolution" bottom: "data" top: "conv"
        convolution_param { num_output: 3 kernel_size: 1 weight_filler { type: "gaussian" std: 1 }
                            bias_filler { type: "constant" value: 0.5 } } }
layer { name: "relu" type: "ReLU" bottom: "conv" top: "conv" }
layer { name: "fc" type: "InnerProduct" bottom: "conv" top: "fc"
        inner_product_param { num_output: 5 weight_filler { type: "xavier" } } }
"""

IMAGE = np.arange(32, dtype=np.float32).reshape(1, 2, 4, 4) / 8 - 2
X = np.array([[-1, 0, 1], [2, 3, -4]], np.float32)
DOUBLE = np.array([[0, 0, 2], [4, 6, 0]], np.float32)


class Scripts(FolderTest):
    def write(self, text, name='net.prototxt'):
        path = self.folder / name
        path.write_text(text)
        return str(path)

    def net(self, text=CHAIN, **options):
        return caffe.Net(self.write(text), caffe.TEST, **options)


def convolved(net, fc='fc'):
    weights, bias = (blob.data for blob in net.params['conv'])
    conv = np.einsum('oi,nihw->nohw', weights[:, :, 0, 0], IMAGE) + bias[:, np.newaxis, np.newaxis]
    conv = np.maximum(conv, 0)
    weights, bias = (blob.data for blob in net.params[fc])
    return conv, conv.reshape(1, -1) @ weights.T + bias


class MemoryData(Scripts):
    NET = '''
    layer { name: "images" type: "MemoryData" top: "data" top: "label"
            memory_data_param { batch_size: 2 channels: 1 height: 1 width: 3 } }
    layer { name: "double" type: "Power" bottom: "data" top: "double" power_param { scale: 2 } }
    '''
    IMAGES = np.arange(12, dtype=np.float32).reshape(4, 1, 1, 3)
    LABELS = np.float32([5, 6, 7, 8]).reshape(4, 1, 1, 1)

    def net(self, more=''):
        with warnings.catch_warnings():
            warnings.simplefilter('ignore')  # about the conversion to an input
            return super().net(self.NET + more)

    def test_batches_follow_each_other(self):
        net = self.net()
        net.set_input_arrays(self.IMAGES, self.LABELS)
        for batch in (self.IMAGES[:2], self.IMAGES[2:], self.IMAGES[:2]):
            np.testing.assert_array_equal(net.forward()['double'], 2 * batch)
        net.forward(data=self.IMAGES[2:])
        np.testing.assert_array_equal(net.forward()['double'], 2 * self.IMAGES[2:])

    def test_labels_go_where_they_are_read(self):
        net = self.net('layer { name: "less" type: "Power" bottom: "label" top: "less" power_param { shift: -5 } }')
        net.set_input_arrays(self.IMAGES, self.LABELS)
        net.forward()
        np.testing.assert_array_equal(net.forward()['less'], [2, 3])

    def test_rejects_other_shapes(self):
        net = self.net()
        with self.assertRaisesRegex(ValueError, 'multiple of the batch size 2, found .3, 1, 1, 3.'):
            net.set_input_arrays(self.IMAGES[:3], self.LABELS[:3])
        with self.assertRaisesRegex(ValueError, 'expected images of shape .1, 1, 3.'):
            net.set_input_arrays(self.IMAGES[..., :2], self.LABELS)
        with self.assertRaisesRegex(ValueError, 'expected 4 labels'):
            net.set_input_arrays(self.IMAGES, self.LABELS[:3])


class BnWeights(Scripts):
    def test_without_a_file_come_from_fillers(self):
        layer = 'layer { name: "%s" type: "BN" bottom: "data" top: "%s" bn_param { %s } }'
        net = self.net(
            'layer { name: "data" type: "Input" top: "data" input_param { shape { dim: 1 dim: 2 dim: 4 } } }'
            + layer % ('p', 'p', 'slope_filler { value: 3 } bias_filler { value: 2 } frozen: true')
            + layer % ('s', 's', 'scale_filler { value: 4 } shift_filler { value: 0.5 } bn_mode: INFERENCE')
        )
        values = {name: [blob.data.ravel().tolist() for blob in blobs] for name, blobs in net.params.items()}
        self.assertEqual(values['p'], [[3, 3], [2, 2], [0, 0], [1, 1]])
        self.assertEqual(values['s'], [[4, 4], [0.5, 0.5]])
        self.assertEqual(net.params['s'][0].data.shape, (1, 2, 1, 1))


class Names(Scripts):
    def test_are_those_of_caffe(self):
        net = self.net()
        self.assertEqual(
            net._layer_names,
            ['data', 'double', 'relu', 'double_relu_0_split', 'plus', 'minus', 'sum'],
        )
        copies = ['double_relu_0_split_0', 'double_relu_0_split_1']
        self.assertEqual(list(net.blobs), ['data', 'double', *copies, 'plus', 'minus', 'sum'])
        self.assertEqual(net._blob_names, list(net.blobs))
        self.assertEqual((net.inputs, net.outputs), (['data'], ['sum']))
        self.assertEqual(net.bottom_names['minus'], [copies[1]])
        self.assertEqual(net.top_names['double_relu_0_split'], copies)
        self.assertEqual(net.layer_dict['relu'].type, 'ReLU')
        self.assertEqual([layer.type for layer in net.layers][3], 'Split')

    def test_outputs_are_sorted(self):
        net = self.net(
            CHAIN.replace('name: "sum"', 'name: "last"').replace(
                'bottom: "minus"', 'bottom: "data"'
            )
        )
        self.assertEqual(net.outputs, ['minus', 'sum'])

    def test_weights(self):
        net = self.net(WEIGHTED)
        self.assertEqual(list(net.params), ['conv', 'fc'])
        self.assertEqual([blob.shape for blob in net.params['fc']], [[5, 48], [5]])
        self.assertIs(type(net.params['fc']), caffe._caffe.BlobVec)

    def test_levels_and_stages(self):
        ruled = (
            CHAIN + 'layer { name: "more" type: "Power" bottom: "sum" top: "more" include { %s } }'
        )
        stage, level = ruled % 'stage: "deep"', ruled % 'min_level: 1'
        self.assertEqual(self.net(stage).outputs, ['sum'])
        self.assertEqual(self.net(stage, stages=['deep']).outputs, ['more'])
        self.assertEqual(self.net(level).outputs, ['sum'])
        self.assertEqual(self.net(level, level=1).outputs, ['more'])
        self.assertEqual(self.net(ruled % 'not_stage: "deep"', stages=['deep']).outputs, ['sum'])
        self.assertEqual(self.net(ruled % 'max_level: 0 min_level: 0', level=1).outputs, ['sum'])

    def test_phases(self):
        phases = (
            WEIGHTED
            + """
layer { name: "extra" type: "InnerProduct" bottom: "fc" top: "extra" include { phase: TRAIN }
        inner_product_param { num_output: 2 } }
"""
        )
        self.assertEqual(list(self.net(phases).params), ['conv', 'fc'])
        net = caffe.Net(self.write(phases), caffe.TRAIN)
        self.assertEqual(list(net.params), ['conv', 'fc', 'extra'])
        self.assertEqual(net.params['extra'][0].shape, [2, 5])


class Blobs(Scripts):
    def test_hold_the_last_values(self):
        net = self.net()
        net.blobs['data'].data[...] = X
        out = net.forward()
        np.testing.assert_array_equal(net.blobs['double'].data, DOUBLE)  # after the ReLU
        np.testing.assert_array_equal(net.blobs['double_relu_0_split_1'].data, DOUBLE)
        self.assertEqual(list(out), ['sum'])
        np.testing.assert_array_equal(out['sum'], 2 * DOUBLE)

    def test_a_layer_in_place_on_the_input_overwrites_it(self):
        net = self.net(
            CHAIN.replace('top: "double" power_param', 'top: "data" power_param').replace(
                'bottom: "double" top: "double"', 'bottom: "data" top: "double"'
            )
        )
        net.blobs['data'].data[...] = X
        net.forward()
        np.testing.assert_array_equal(net.blobs['data'].data, 2 * X)
        net.forward()
        np.testing.assert_array_equal(net.blobs['data'].data, 4 * X)

    def test_arrays_stay_views(self):
        net = self.net()
        data, total = net.blobs['data'].data, net.forward()['sum']
        row = net.blobs['double'].data[1]
        data[...] = X
        net.forward()
        np.testing.assert_array_equal(total, 2 * DOUBLE)
        np.testing.assert_array_equal(row, DOUBLE[1])
        data[...] = -1
        net.forward()
        np.testing.assert_array_equal(total, np.zeros((2, 3)))

    def test_shapes_are_known_before_the_first_pass(self):
        blob = self.net(WEIGHTED).blobs['conv']
        self.assertEqual((blob.shape, blob.count), ([1, 3, 4, 4], 48))
        self.assertEqual((blob.num, blob.channels, blob.height, blob.width), (1, 3, 4, 4))
        self.assertEqual((blob.data.shape, blob.data.dtype), ((1, 3, 4, 4), np.float32))
        self.assertEqual((blob.diff.shape, blob.diff.any()), ((1, 3, 4, 4), False))

    def test_reshape(self):
        net = self.net()
        net.blobs['data'].reshape(4, 3)
        self.assertEqual(net.blobs['sum'].shape, [2, 3])
        net.reshape()
        self.assertEqual(
            [net.blobs[name].shape for name in ('data', 'double', 'sum')], [[4, 3]] * 3
        )
        net.blobs['data'].reshape(1, 2)
        net.blobs['data'].data[...] = [[5, -5]]
        np.testing.assert_array_equal(net.forward()['sum'], [[20, 0]])  # without reshape()
        net.blobs['data'].reshape(4 / 2, 3)
        self.assertEqual(net.blobs['data'].shape, [2, 3])
        for wrong in [(-1, 2), ('two', 3), (2.5, 3)]:
            with self.assertRaises(ValueError):
                net.blobs['data'].reshape(*wrong)

    def test_reshape_keeps_values_in_order(self):
        blob = self.net().blobs['data']
        blob.data[...] = X
        blob.reshape(3, 2)
        np.testing.assert_array_equal(blob.data, X.reshape(3, 2))

    def test_a_shape_that_no_weights_fit(self):
        net = self.net(WEIGHTED)
        net.blobs['data'].reshape(1, 2, 5, 5)
        with self.assertRaisesRegex(revisit.InputError, "net.prototxt: layer 'fc'"):
            net.forward()

    def test_outlive_the_net(self):
        net = self.net()
        net.blobs['data'].data[...] = X
        net.forward()
        blob, array = net.blobs['plus'], net.blobs['sum'].data
        del net
        np.testing.assert_array_equal(blob.data, DOUBLE + 10)
        np.testing.assert_array_equal(array, 2 * DOUBLE)

    def test_a_net_goes_when_it_is_let_go(self):
        gc.disable()
        self.addCleanup(gc.enable)
        net = self.net(WEIGHTED)
        net.forward()
        net.forward(start='relu')
        engine = weakref.ref(net._ranges)
        del net
        self.assertIsNone(engine())


class Passes(Scripts):
    def test_from_the_middle(self):
        net = self.net()
        net.blobs['data'].data[...] = X
        net.forward()
        net.blobs['double'].data[...] = -X
        out = net.forward(start='plus')
        np.testing.assert_array_equal(out['sum'], -2 * X)
        np.testing.assert_array_equal(net.blobs['double'].data, -X)  # the ReLU did not run
        self.assertEqual(set(net.forward(start='relu', end='plus')), {'plus'})
        np.testing.assert_array_equal(net.blobs['double'].data, np.maximum(-X, 0))
        np.testing.assert_array_equal(net.blobs['minus'].data, -X - 10)

    def test_up_to_the_middle(self):
        net = self.net()
        net.blobs['data'].data[...] = X
        out = net.forward(end='double', blobs=['data'])
        np.testing.assert_array_equal(out['double'], 2 * X)
        np.testing.assert_array_equal(out['data'], X)
        self.assertFalse(net.blobs['sum'].data.any())
        self.assertEqual(list(net.forward(end='data')), ['data'])

    def test_inputs_need_not_be_in_the_range(self):
        net = self.net(WEIGHTED)
        self.assertIs(net._ranges.part(1, 3), net._ranges.part(0, 3))
        self.assertEqual(net.forward(start='conv')['fc'].shape, (1, 5))

    def test_oldest_passes_are_forgotten(self):
        net = self.net(WEIGHTED)
        for batch in (1, 2, 1):
            net.blobs['data'].reshape(batch, 2, 4, 4)
            net.blobs['data'].data[...] = IMAGE
            net.forward()
            for start, end in itertools.combinations_with_replacement(('conv', 'relu', 'fc'), 2):
                net.forward(start=start, end=end)
        self.assertEqual(len(net._ranges._passes), 8)
        net.forward()
        np.testing.assert_allclose(net.blobs['fc'].data, convolved(net)[1], rtol=1e-5, atol=1e-5)

    def test_a_layer_that_is_not_there(self):
        with self.assertRaisesRegex(ValueError, 'plus'):
            self.net().forward(start='pluss')

    def test_inputs_by_name(self):
        net = self.net()
        np.testing.assert_array_equal(net.forward(data=X)['sum'], 2 * DOUBLE)
        for wrong in [{'dat': X}, {'data': X[:1]}]:
            with self.assertRaises(ValueError):
                net.forward(**wrong)

    def test_forward_all_fills_the_last_batch(self):
        images = np.arange(15, dtype=np.float32).reshape(5, 3)
        out = self.net().forward_all(data=images, blobs=['double'])
        np.testing.assert_array_equal(out['sum'], 4 * images)
        np.testing.assert_array_equal(out['double'], 2 * images)
        with self.assertRaisesRegex(ValueError, 'data'):
            self.net().forward_all()

    def test_forward_all_of_nothing_is_nothing(self):
        out = self.net().forward_all(data=np.zeros((0, 3), np.float32), blobs=['double'])
        self.assertEqual({name: array.size for name, array in out.items()}, {'double': 0, 'sum': 0})

    def test_no_detection_is_a_row_for_each_image(self):
        net = self.net("""
layer { name: "in" type: "Input" top: "loc" top: "conf" top: "prior" input_param {
        shape { dim: 2 dim: 4 } shape { dim: 2 dim: 2 } shape { dim: 1 dim: 2 dim: 4 } } }
layer { name: "found" type: "DetectionOutput" bottom: "loc" bottom: "conf" bottom: "prior" top: "found"
        detection_output_param { num_classes: 2 keep_top_k: 5 confidence_threshold: 0.5
                                 nms_param { nms_threshold: 0.45 top_k: 5 } } }
""")
        net.blobs['prior'].data[...] = [[[0.1, 0.2, 0.3, 0.4], [1, 1, 1, 1]]]
        net.blobs['conf'].data[...] = [[0, 0.9], [1, 0.1]]
        np.testing.assert_allclose(net.forward()['found'], [[[[0, 1, 0.9, 0.1, 0.2, 0.3, 0.4]]]])
        net.blobs['conf'].data[...] = 0
        nothing = [-1] * 6
        np.testing.assert_array_equal(net.forward()['found'], [[[[0, *nothing], [1, *nothing]]]])

    def test_partial_passes_have_the_weights(self):
        net = self.net(WEIGHTED)
        net.blobs['data'].data[...] = IMAGE
        net.forward(end='relu')
        conv, fc = convolved(net)
        np.testing.assert_allclose(net.blobs['conv'].data, conv, rtol=1e-5, atol=1e-6)
        np.testing.assert_allclose(net.forward(start='fc')['fc'], fc, rtol=1e-5, atol=1e-5)
        net.params['fc'][1].data[...] = 7
        np.testing.assert_allclose(
            net.forward(start='fc')['fc'], convolved(net)[1], rtol=1e-5, atol=1e-5
        )


class Weights(Scripts):
    def check(self, net):
        conv, fc = convolved(net)
        out = net.forward(data=IMAGE)
        np.testing.assert_allclose(net.blobs['conv'].data, conv, rtol=1e-5, atol=1e-6)
        np.testing.assert_allclose(out['fc'], fc, rtol=1e-5, atol=1e-5)
        return fc

    def test_come_from_fillers(self):
        caffe.set_random_seed(3)
        net = self.net(WEIGHTED)
        self.check(net)
        np.testing.assert_array_equal(net.params['conv'][1].data, [0.5] * 3)
        limit = np.sqrt(3 / 48)
        largest = np.abs(net.params['fc'][0].data).max()
        self.assertTrue(0.8 * limit < largest <= limit, largest)
        caffe.set_random_seed(3)
        np.testing.assert_array_equal(
            self.net(WEIGHTED).params['fc'][0].data, net.params['fc'][0].data
        )

    def test_writes_to_weights_count(self):
        net = self.net(WEIGHTED)
        before = self.check(net)
        kept = net.params['fc'][0].data
        kept *= 2
        self.assertFalse(np.allclose(self.check(net), before))
        kept[...] = kept[::-1].copy()  # reordering is a change, too
        self.check(net)
        row = net.params['conv'][0].data[1]
        del kept
        self.check(net)
        row[...] = 3
        self.check(net)

    def test_an_engine_is_loaded_only_after_writes(self):
        net = self.net(WEIGHTED)
        net.forward()
        loaded = net._ranges._engine
        array = net.params['fc'][0].data
        net.forward()
        self.assertIs(net._ranges._engine, loaded)
        array[0, 0] += 1
        net.forward()
        self.assertIsNot(net._ranges._engine, loaded)

    def test_save_and_load(self):
        net = self.net(WEIGHTED)
        path = str(self.folder / 'saved.caffemodel')
        net.save(path)
        fc = self.check(net)
        for again in (
            caffe.Net(self.write(WEIGHTED), path, caffe.TEST),
            caffe.Net(self.write(WEIGHTED), caffe.TEST, weights=path),
            caffe.Net(self.write(WEIGHTED), phase=caffe.TEST, weights=path),
        ):
            np.testing.assert_array_equal(
                again.forward(data=IMAGE)['fc'], net.forward(data=IMAGE)['fc']
            )
        other = self.net(WEIGHTED)
        held = other.params['fc'][0].data
        other.copy_from(path)
        np.testing.assert_array_equal(held, net.params['fc'][0].data)
        np.testing.assert_allclose(self.check(other), fc, rtol=1e-5)
        file = caffe.proto.caffe_pb2.NetParameter.FromString(Path(path).read_bytes())
        self.assertEqual(
            [(layer.name, layer.type) for layer in file.layer][1], ('conv', 'Convolution')
        )
        self.assertEqual(list(file.layer[1].blobs[0].shape.dim), [3, 2, 1, 1])
        np.testing.assert_array_equal(file.layer[3].blobs[1].data, net.params['fc'][1].data)

    def test_save_where_nothing_can_be(self):
        net = self.net(WEIGHTED)
        (self.folder / 'folder').mkdir()
        for path in (self.folder / 'missing/file', self.folder / 'folder'):
            with self.assertRaises(OSError):
                net.save(path)
        self.assertEqual(sorted(p.name for p in self.folder.iterdir()), ['folder', 'net.prototxt'])

    def test_save_through_a_link_and_into_a_fifo(self):
        net = self.net(WEIGHTED)
        net.save(self.folder / 'wanted')
        wanted = (self.folder / 'wanted').read_bytes()
        (self.folder / 'link').symlink_to('real')
        net.save(self.folder / 'link')
        self.assertTrue((self.folder / 'link').is_symlink())
        self.assertEqual((self.folder / 'real').read_bytes(), wanted)
        fifo = self.folder / 'fifo'
        os.mkfifo(fifo)
        reader = os.open(fifo, os.O_RDONLY | os.O_NONBLOCK)  # the pipe's buffer holds a net this small
        self.addCleanup(os.close, reader)
        net.save(fifo)
        self.assertTrue(fifo.is_fifo())
        self.assertEqual(os.read(reader, 1 << 16), wanted)
        self.assertEqual(
            sorted(p.name for p in self.folder.iterdir()),
            ['fifo', 'link', 'net.prototxt', 'real', 'wanted'],
        )

    def test_save_and_load_hdf5(self):
        try:
            import h5py  # noqa: F401
        except ImportError:
            self.skipTest('h5py is not installed')
        net, other = self.net(WEIGHTED), self.net(WEIGHTED)
        path = str(self.folder / 'saved.caffemodel.h5')
        net.save_hdf5(path)
        other.load_hdf5(path)
        np.testing.assert_array_equal(other.params['fc'][0].data, net.params['fc'][0].data)

    def test_layers_that_the_file_lacks_keep_theirs(self):
        path = str(self.folder / 'saved.caffemodel')
        self.net(WEIGHTED).save(path)
        renamed = WEIGHTED.replace('name: "fc"', 'name: "fc_new"')
        with self.assertWarnsRegex(UserWarning, 'fc_new'):
            net = caffe.Net(self.write(renamed), path, caffe.TEST)
        self.assertTrue(net.params['fc_new'][0].data.any())
        np.testing.assert_allclose(
            net.forward(data=IMAGE)['fc'], convolved(net, 'fc_new')[1], rtol=1e-5, atol=1e-5
        )

    def test_weights_of_another_net(self):
        path = str(self.folder / 'saved.caffemodel')
        self.net(WEIGHTED).save(path)
        with self.assertRaisesRegex(revisit.InputError, 'saved.caffemodel.*fc'):
            self.net(WEIGHTED.replace('num_output: 5', 'num_output: 6'), weights=path)
        with self.assertRaises(OSError):
            self.net(WEIGHTED, weights=str(self.folder / 'nothing.caffemodel'))

    def test_shared_between_nets(self):
        one, other = self.net(WEIGHTED), self.net(WEIGHTED)
        other.share_with(one)
        one.params['fc'][0].data[...] = 0.25
        np.testing.assert_allclose(self.check(other), self.check(one))
        other.params['conv'][1].data[...] = -0.5
        np.testing.assert_allclose(self.check(other), self.check(one))

    def test_shared_between_layers(self):
        shared = """
layer { name: "data" type: "Input" top: "data" input_param { shape { dim: 1 dim: 3 } } }
layer { name: "a" type: "InnerProduct" bottom: "data" top: "a" param { name: "w" }
        inner_product_param { num_output: 3 bias_term: false weight_filler { type: "uniform" } } }
layer { name: "b" type: "InnerProduct" bottom: "a" top: "b" param { name: "w" }
        inner_product_param { num_output: 3 bias_term: false } }
"""
        net = self.net(shared)
        weights = net.params['b'][0].data
        np.testing.assert_array_equal(weights, net.params['a'][0].data)
        weights[...] = np.diag([1, 2, 3])
        np.testing.assert_array_equal(net.forward(data=np.ones((1, 3)))['b'], [[1, 4, 9]])


class Refused(Scripts):
    def test_training(self):
        net = self.net()
        for call in (
            net.backward,
            net.forward_backward_all,
            lambda: caffe.SGDSolver('solver.prototxt'),
            lambda: caffe.get_solver('solver.prototxt'),
            caffe.Net(self.write(CHAIN), caffe.TRAIN).forward,
        ):
            with self.assertRaisesRegex(caffe.TrainingError, 'caffemodel'):
                call()
        self.assertTrue(issubclass(caffe.TrainingError, NotImplementedError))

    def test_gpu_is_a_warning(self):
        with self.assertWarnsRegex(UserWarning, 'CPU'):
            caffe.set_mode_gpu()
        with warnings.catch_warnings():
            warnings.simplefilter('error')
            caffe.set_mode_cpu()

    def test_unsupported_layers(self):
        with self.assertRaisesRegex(revisit.UnsupportedError, 'Stranger'):
            self.net(CHAIN.replace('ReLU', 'Stranger'))
        for unread in ('HDF5Output', 'OfAFork', 'EuclideanLoss'):  # without an output, they are skipped
            net = self.net(CHAIN + f'layer {{ name: "last" type: "{unread}" bottom: "sum" bottom: "plus" }}')
            net.blobs['data'].data[...] = X
            net.forward()
            np.testing.assert_array_equal(net.blobs['sum'].data, 2 * DOUBLE)
        with self.assertRaisesRegex(revisit.InputError, r"layer 'last' \(Softmax\) has no top"):
            self.net(CHAIN + 'layer { name: "last" type: "Softmax" bottom: "sum" }')

    def test_unknown_fields(self):
        beside = CHAIN.replace('top: "plus"', 'top: "plus" odd_param { }')
        with self.assertRaisesRegex(revisit.InputError, r"layer 'plus' .*odd_param.*caffe.set_allow_unknown\(True\)"):
            self.net(beside)
        caffe.set_allow_unknown(True)
        self.addCleanup(caffe.set_allow_unknown, False)
        with self.assertWarnsRegex(UserWarning, 'odd_param.*ignored'):
            self.net(beside)
        with self.assertRaisesRegex(revisit.InputError, 'may change results'):
            self.net(CHAIN.replace('shift: 10', 'shift: 10 odd: 1'))

    def test_dropout_that_samples(self):
        text = """
layer { name: "data" type: "Input" top: "data" input_param { shape { dim: 1 dim: 1000 } } }
layer { name: "drop" type: "Dropout" bottom: "data" top: "drop" dropout_param { sample_weights_test: true } }
"""

        def passes():
            caffe.set_random_seed(7)
            net = self.net(text)
            return [net.forward(data=np.ones((1, 1000)))['drop'].copy() for _ in range(2)]

        first, second = passes()
        self.assertEqual(set(np.unique(first)), {0, 2})
        self.assertTrue((first != second).any())
        np.testing.assert_array_equal(passes(), [first, second])
        net, repeated = self.net(text), []
        for _ in range(2):
            caffe.set_random_seed(7)
            repeated.append(net.forward(data=np.ones((1, 1000)))['drop'].copy())
        np.testing.assert_array_equal(repeated, [first, first])

    def test_callbacks_see_each_layer(self):
        plain = self.net(WEIGHTED).forward(data=IMAGE)
        caffe.set_random_seed(3)
        net, seen = self.net(WEIGHTED), []
        whole = {name: array.copy() for name, array in net.forward(data=IMAGE).items()}
        net.before_forward(lambda i: seen.append(('before', net._layer_names[i])))
        net.after_forward(lambda i: seen.append(('after', net._layer_names[i])))
        for name, array in net.forward(data=IMAGE).items():
            np.testing.assert_allclose(array, whole[name], rtol=1e-5, atol=1e-6)
        self.assertEqual(seen, [(when, name) for name in net._layer_names for when in ('before', 'after')])
        self.assertEqual(set(plain), set(whole))
        net.before_forward(lambda i: net.blobs['data'].data.fill(0))  # may change what the next layer reads
        self.assertFalse(np.allclose(net.forward(data=IMAGE)['fc'], whole['fc']))
        with self.assertRaisesRegex(caffe.TrainingError, 'gradients are not computed'):
            net.before_backward(print)

    def test_modules_of_pycaffe_exist_or_say_what_to_do(self):
        from revisit.caffe import draw, pycaffe
        self.assertIs(pycaffe.Net, caffe.Net)
        with self.assertRaisesRegex(ImportError, 'copy .*model_libs.py'):
            from revisit.caffe import model_libs  # noqa: F401
        net = text_format.Parse(WEIGHTED, caffe.proto.caffe_pb2.NetParameter())
        self.assertEqual(draw.get_edge_label(net.layer[1]), '3')
        self.assertEqual(draw.get_layer_label(net.layer[1], 'LR'), r'conv\n(Convolution)\nkernel size: 1 stride: 1 pad: 0')
        try:
            import pydot  # noqa: F401
        except ImportError:
            with self.assertRaisesRegex(ImportError, 'pip install pydot'):
                draw.get_pydot_graph(net, 'LR')
            return
        text = draw.get_pydot_graph(net, 'LR').to_string()
        self.assertEqual(text.count('->'), sum(len(layer.top) + len(layer.bottom) for layer in net.layer))

    def test_a_net_without_its_phase(self):
        file = self.write(WEIGHTED)
        for args, kwargs in ([], {}), (['x.caffemodel'], {}), ([], {'weights': 'x.caffemodel'}):
            with self.assertRaisesRegex(TypeError, r'Net\(prototxt, phase\).*Net\(prototxt, weights, phase\).*caffe.TEST'):
                caffe.Net(file, *args, **kwargs)

    def test_blobs_without_maker_or_shape(self):
        with self.assertRaisesRegex(revisit.InputError, "net.prototxt: layer 'double'"):
            self.net(CHAIN.replace('bottom: "data"', 'bottom: "date"'))
        with self.assertRaisesRegex(revisit.InputError, 'has no shape'):
            self.net(CHAIN.replace('input_param { shape { dim: 2 dim: 3 } }', ''))

    def test_syntax_errors(self):
        with self.assertRaisesRegex(revisit.InputError, 'net.prototxt:1:'):
            self.net('name: 3')
        with self.assertRaises(revisit.InputError):
            caffe.Net(str(self.folder / 'missing.prototxt'), caffe.TEST)

    def test_arguments(self):
        for arguments in [(), (7,), ('weights',)]:
            with self.assertRaises((TypeError, ValueError)):
                caffe.Net(self.write(CHAIN), *arguments)


if __name__ == '__main__':
    unittest.main()
