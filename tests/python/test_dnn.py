"""revisit.dnn without OpenCV. Expected values are those of cv2.dnn 4.14; tests/weights_conversion/dnn_test.py compares with it."""

import os
import subprocess
import sys
import tempfile
import types
import unittest
import warnings
from pathlib import Path
from unittest import mock

import nets
import numpy as np

import revisit
from revisit import dnn, proto

TEXT = nets.CONVOLVE.replace('layer { name: "relu"', 'layer { name: "conv"')
SSD = '''
input: "data" input_shape { dim: 1 dim: 1 dim: 8 dim: 8 }
layer { name: "loc" type: "Power" bottom: "data" top: "loc" power_param { scale: 0 } }
layer { name: "loc_slice" type: "Pooling" bottom: "loc" top: "loc_pool" pooling_param { kernel_size: 4 stride: 4 } }
layer { name: "loc_join" type: "Concat" bottom: "loc_pool" bottom: "loc_pool" bottom: "loc_pool" bottom: "loc_pool" top: "loc_join" }
layer { name: "loc_flat" type: "Flatten" bottom: "loc_join" top: "loc_flat" }
layer { name: "max" type: "Pooling" bottom: "data" top: "max" pooling_param { kernel_size: 4 stride: 4 } }
layer { name: "rest" type: "Power" bottom: "max" top: "rest" power_param { scale: -1 shift: 1 } }
layer { name: "conf" type: "Concat" bottom: "rest" bottom: "max" top: "conf" }
layer { name: "conf_perm" type: "Permute" bottom: "conf" top: "conf_perm" permute_param { order: 0 order: 2 order: 3 order: 1 } }
layer { name: "conf_flat" type: "Flatten" bottom: "conf_perm" top: "conf_flat" }
layer { name: "priors" type: "PriorBox" bottom: "max" bottom: "data" top: "priors" prior_box_param { min_size: 4 } }
layer { name: "boxes" type: "DetectionOutput" bottom: "loc_flat" bottom: "conf_flat" bottom: "priors" top: "boxes"
        detection_output_param { num_classes: 2 share_location: true nms_param { nms_threshold: 0.45 }
        code_type: CENTER_SIZE keep_top_k: 5 confidence_threshold: 0.3 } }
'''


def weights_of(text, **weights):
    file = proto.parse_net(text)
    file.set_weights(weights)
    return file.to_bytes()


def conv_net():
    """Returns the net of TEXT; its convolution sums the channels of a pixel, times the number of its output."""
    kernel = np.zeros((4, 3, 3, 3), np.float32)
    kernel[:, :, 1, 1] = np.arange(4)[:, None]
    fc = np.arange(5 * 80, dtype=np.float32).reshape(5, 80) / 400
    return dnn.readNetFromCaffe(TEXT.encode(), weights_of(nets.CONVOLVE, conv=[kernel, np.full(4, -1, np.float32)],
                                                          fc=[fc, np.zeros(5, np.float32)]))


class CropLayer:
    """Crops about the center, as scripts for HED register it in OpenCV."""

    def __init__(self, params, blobs):
        pass

    def getMemoryShapes(self, inputs):
        (_, _, height, width), (_, _, rows, columns) = inputs
        self.y, self.x, self.size = (height - rows) // 2, (width - columns) // 2, (rows, columns)
        return [[*inputs[0][:2], rows, columns]]

    def forward(self, inputs):
        return [inputs[0][:, :, self.y : self.y + self.size[0], self.x : self.x + self.size[1]]]


class Nets(unittest.TestCase):
    def setUp(self):
        self.net = conv_net()
        self.blob = np.ones((1, 3, 8, 10), np.float32)

    def test_names_are_those_of_layers(self):
        net = self.net
        self.assertEqual(net.getLayerNames(), ('conv', 'conv_1', 'pool', 'fc', 'prob'))
        self.assertEqual((net.getLayerId('fc'), net.getLayerId('data'), net.getLayerId('nix')), (4, -1, -1))
        self.assertEqual((list(net.getUnconnectedOutLayers()), net.getUnconnectedOutLayersNames()), ([5], ('prob',)))
        self.assertEqual((net.getLayer(2).name, net.getLayer('conv_1').type), ('conv_1', 'ReLU'))
        self.assertEqual([net.getLayersCount(kind) for kind in ('ReLU', '__NetInputLayer__', 'other')], [1, 1, 0])
        self.assertEqual([net.getLayer(0).outputNameToIndex(name) for name in ('data', 'im_info')], [0, -1])
        self.assertIn('__NetInputLayer__', net.getLayerTypes())

    def test_a_convolution_has_the_name_of_its_output(self):
        text = 'input: "x" input_shape { dim: 1 dim: 1 dim: 2 dim: 2 }\n' \
               'layer { name: "a" type: "Convolution" bottom: "x" top: "b" convolution_param { num_output: 1 kernel_size: 1 } }\n' \
               'layer { name: "end" type: "Silence" bottom: "b" }'
        net = dnn.readNetFromCaffe(text.encode(), weights_of(text, a=[np.full((1, 1, 1, 1), 3, np.float32), np.ones(1, np.float32)]))
        self.assertEqual(net.getLayerNames(), ('b', 'end'))
        net.setInput(np.ones((1, 1, 2, 2)))
        self.assertEqual(net.forward().ravel().tolist(), [4, 4, 4, 4])  # a Silence shows its input
        taken = text.replace('name: "end" type: "Silence"', 'name: "b" type: "TanH" top: "t"')
        self.assertEqual(dnn.readNetFromCaffe(taken.encode()).getLayerNames(), ('a', 'b'))  # as another layer has that name

    def test_names_that_repeat_or_lack(self):
        def add(name, value, bottom):
            return f'layer {{ {name} type: "Power" bottom: "{bottom}" top: "{value}" power_param {{ shift: {value} }} }}\n'
        start = 'input: "x" input_shape { dim: 1 dim: 1 }\n'
        for names, expected in ((['name: "r"', 'name: "r"', 'name: "r_1"'], ('r', 'r_2', 'r_1')), (['', 'name: "s"', ''], ('', 's', '_1'))):
            net = dnn.readNetFromCaffe((start + add(names[0], 1, 'x') + add(names[1], 10, '1') + add(names[2], 100, '10')).encode())
            self.assertEqual(net.getLayerNames(), expected)
            net.setInput(np.zeros((1, 1)))
            for name, value in zip(expected, (1, 11, 111)):
                self.assertEqual(net.forward(name)[0, 0], value if name else 111)  # '': the last layer

    def test_forward(self):
        self.net.setInput(self.blob)
        first = self.net.forward()
        np.testing.assert_allclose(first, [[0, 0, 0, 0, 1]], atol=1e-6)
        before, after = self.net.forward(['conv', 'conv_1'])
        self.assertEqual((before[0, :, 0, 0].tolist(), after[0, :, 0, 0].tolist()), ([-1, 2, 5, 8], [0, 2, 5, 8]))
        self.assertEqual(self.net.forward('pool').shape, (1, 4, 4, 5))
        self.net.setInput(np.zeros((2, 3, 8, 10), np.uint8))
        self.assertEqual(self.net.forward().shape, (2, 5))
        self.assertEqual(first[0, 4], 1)  # a copy
        self.assertEqual(self.net.forward(None).shape, (2, 5))
        self.assertEqual([len(arrays) for arrays in self.net.forwardAndRetrieve(['pool', 'fc'])], [1, 1])

    def test_inputs(self):
        self.net.setInput(self.blob * 10, 'data', 0.5, (2, 4, 6))
        self.assertEqual(self.net.forward('conv')[0, :, 3, 3].tolist(), [-1, 8, 17, 26])
        self.net.setInputsNames(['image'])
        self.net.setInput(self.blob, 'image', None, None)
        self.assertEqual(self.net.forward('conv')[0, :, 3, 3].tolist(), [-1, 2, 5, 8])
        with self.assertRaisesRegex(revisit.UsageError, "no input 'data'; expected one of image"):
            self.net.setInput(self.blob, 'data')
        self.net.setInput(np.ones((1, 3, 4, 4)))
        with self.assertRaisesRegex(revisit.InputError, 'fc'):
            self.net.forward()
        with self.assertRaisesRegex(revisit.UsageError, "call setInput"):
            conv_net().forward()
        with self.assertRaisesRegex(revisit.UsageError, 'no layer .*names of layers'):
            self.net.forward('data')

    def test_an_input_without_a_shape(self):
        text = 'input: "x"\nlayer { name: "p" type: "Power" bottom: "x" top: "p" power_param { scale: 2 } }'
        net = dnn.readNetFromCaffe(text.encode())
        net.setInput(np.ones((1, 2, 3)))
        self.assertEqual(net.forward().tolist(), (2 * np.ones((1, 2, 3))).tolist())

    def test_weights(self):
        net = self.net
        self.assertEqual([net.getParam('conv', i).shape for i in (0, 1)] + [net.getParam('fc', 1).shape], [(4, 3, 3, 3), (4, 1), (1, 5)])
        net.setInput(self.blob)
        net.setParam('conv', 1, [7, 7, 7, 7])
        self.assertEqual(net.forward('conv')[0, :, 0, 0].tolist(), [7, 10, 13, 16])
        layer = net.getLayer('conv')
        layer.blobs = [layer.blobs[0] * 2]  # the bias becomes 0
        self.assertEqual(net.forward('conv')[0, :, 0, 0].tolist(), [0, 6, 12, 18])
        text = 'input: "x" input_shape { dim: 1 dim: 2 dim: 1 dim: 1 }\n' \
               'layer { name: "p" type: "PReLU" bottom: "x" top: "p" prelu_param { channel_shared: true } }'
        shared = dnn.readNetFromCaffe(text.encode())
        shared.setParam('p', 0, [0.5])  # an array without axes
        shared.setInput([[[[-2]], [[4]]]])
        self.assertEqual(shared.forward().ravel().tolist(), [-1, 4])
        with self.assertRaisesRegex(revisit.UsageError, 'expected 4 values'):
            net.setParam('conv', 1, [1])
        with self.assertRaisesRegex(revisit.UsageError, 'none of index 2'):
            net.getParam('conv', 2)

    def test_missing_weights_can_be_set(self):
        net = dnn.readNetFromCaffe(TEXT.encode())
        net.setInput(self.blob)
        self.assertEqual(net.getMemoryConsumption((1, 3, 8, 10))[0], 4 * (112 + 405))
        with self.assertRaisesRegex(revisit.InputError, 'conv.*getLayer'):
            net.forward()
        net.setParam('conv', 1, np.zeros(4))
        with self.assertRaisesRegex(revisit.InputError, 'conv.*getLayer'):  # its kernel is still missing
            net.forward('conv')
        with self.assertRaisesRegex(revisit.UsageError, "'conv' has 2 arrays"):
            net.getLayer(1).blobs = []
        net.getLayer(1).blobs = [np.zeros((4, 3, 3, 3))]
        self.assertEqual(net.forward('conv').max(), 0)
        with self.assertRaises(revisit.InputError):
            net.forward()

    def test_costs(self):
        shape = (1, 3, 8, 10)
        self.assertEqual(self.net.getFLOPS([shape]), 2 * (4 * 27 * 80 + 400))
        self.assertEqual(self.net.getFLOPS(1, shape), 2 * 4 * 27 * 80)
        self.assertEqual(self.net.getMemoryConsumption(shape), (2068, 4 * (240 + 320 + 320 + 80 + 5 + 5)))
        numbers, inputs, outputs = self.net.getLayersShapes(shape)
        self.assertEqual((numbers.tolist(), numbers.dtype), ([0, 1, 2, 3, 4, 5], np.int32))
        self.assertEqual([inputs[i][0].tolist() for i in (0, 1, 3)], [[1, 3, 8, 10], [1, 3, 8, 10], [1, 4, 8, 10]])
        self.assertEqual([outputs[i][0].tolist() for i in (0, 3, 5)], [[1, 3, 8, 10], [1, 4, 4, 5], [1, 5]])
        first = self.net.getLayer(0)
        self.assertEqual((first.name, first.type, first.blobs), ('_input', '', ()))
        self.net.setInput(self.blob)
        self.net.forward()
        ticks, times = self.net.getPerfProfile()
        self.assertGreater(ticks, 0)
        self.assertEqual(times.shape, (5,))

    def test_detections(self):
        net = dnn.readNetFromCaffe(SSD.encode())
        image = np.zeros((1, 1, 8, 8), np.float32)
        net.setInput(image)
        self.assertEqual(net.forward().tolist(), np.zeros((1, 1, 5, 7)).tolist())
        image[0, 0, 1, 1], image[0, 0, 5, 6] = 0.5, 0.75
        net.setInput(image)
        rows = net.forward()[0, 0]
        np.testing.assert_allclose(rows[:3], [[0, 1, 0.75, 0.5, 0.5, 1, 1], [0, 1, 0.5, 0, 0, 0.5, 0.5], [0] * 7])
        wide = dnn.readNetFromCaffe(SSD.replace('min_size: 4', 'min_size: 10').replace('keep_top_k', 'clip: true keep_top_k').encode())
        wide.setInput(image)
        np.testing.assert_allclose(wide.forward()[0, 0, 0], [0, 1, 0.75, 0.125, 0.125, 1, 1])
        model = dnn.DetectionModel(net)
        frame = np.zeros((80, 100), np.uint8)
        self.assertEqual([len(found) for found in model.detect(frame)], [0, 0, 0])
        frame[40:, 50:] = 1
        classes, confidences, boxes = model.detect(frame)
        self.assertEqual((classes.tolist(), confidences.tolist(), boxes.tolist()), ([1], [1], [[50, 40, 50, 40]]))

    def test_a_registered_crop(self):
        text = 'input: "x" input_shape { dim: 1 dim: 1 dim: 6 dim: 9 } input: "y" input_shape { dim: 1 dim: 1 dim: 2 dim: 3 }\n' \
               'layer { name: "k" type: "Crop" bottom: "x" bottom: "y" top: "k" }'
        net = dnn.readNetFromCaffe(text.encode())
        net.setInput(np.arange(54).reshape(1, 1, 6, 9), 'x')
        net.setInput(np.zeros((1, 1, 2, 3)), 'y')
        self.assertEqual(net.forward().ravel().tolist(), [0, 1, 2, 9, 10, 11])
        padded = (b'input: "x" input_shape { dim: 1 dim: 1 dim: 6 dim: 6 } layer { name: "c" type: "Convolution" bottom: "x" top: "c" '
                  b'convolution_param { num_output: 1 kernel_size: 1 pad: 2 } } layer { name: "k" type: "Crop" bottom: "c" bottom: "x" top: "k" }')
        with self.assertWarnsRegex(UserWarning, 'has no crop_param'):
            dnn.readNetFromCaffe(padded)
        dnn.registerLayer('Crop', CropLayer)
        self.addCleanup(dnn._net._registered.clear)
        with warnings.catch_warnings():
            warnings.simplefilter('error')
            dnn.readNetFromCaffe(padded)
        net.setInput(np.zeros((1, 1, 4, 3)), 'y')
        self.assertEqual(net.forward()[0, 0, :, 0].tolist(), [12, 21, 30, 39])
        with self.assertRaisesRegex(revisit.UnsupportedError, "expected 'Crop'"):
            dnn.registerLayer('Other', CropLayer)

    def test_settings(self):
        dnn._net._warn_of_gpu.cache_clear()
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter('always')
            for _ in range(2):
                self.net.setPreferableBackend(dnn.DNN_BACKEND_CUDA)
                self.net.setPreferableTarget(dnn.DNN_TARGET_CUDA)
            self.net.setPreferableTarget(dnn.DNN_TARGET_CPU)
        self.assertEqual(len(caught), 1)
        self.net.enableFusion(False)
        self.net.enableWinograd(False)
        with self.assertRaisesRegex(revisit.UnsupportedError, 'in a thread'):
            self.net.forwardAsync()
        empty = dnn.Net()
        self.assertTrue(empty.empty())
        for call in (empty.forward, empty.getPerfProfile, empty.getLayerTypes, lambda: empty.getLayersCount('ReLU'),
                     lambda: empty.getFLOPS((1, 3, 8, 10))):
            with self.assertRaisesRegex(revisit.UsageError, 'empty'):
                call()


class Reading(unittest.TestCase):
    def test_paths_and_buffers(self):
        weights = weights_of(nets.SCALE)
        with nets.folder_with(net=nets.SCALE) as folder:
            prototxt, caffemodel = folder / 'net.prototxt', folder / 'net.caffemodel'
            caffemodel.write_bytes(weights)
            buffers = np.frombuffer(nets.SCALE.encode(), np.uint8), np.frombuffer(weights, np.uint8)
            read = [dnn.readNetFromCaffe(str(prototxt), str(caffemodel)), dnn.readNetFromCaffe(prototxt), dnn.readNetFromCaffe(*buffers),
                    dnn.readNet(str(caffemodel), str(prototxt)), dnn.readNet(str(prototxt), str(caffemodel)),
                    dnn.readNet('caffe', buffers[1], buffers[0]), dnn.readNetFromCaffe(bufferProto=buffers[0], bufferModel=bytearray(weights))]
            for net in read:
                net.setInput(np.ones((2, 3), np.float32))
                self.assertEqual(net.forward().tolist(), [[3, 3, 3], [3, 3, 3]])
            with self.assertRaisesRegex(revisit.InputError, 'none.caffemodel: cannot be read'):
                dnn.readNetFromCaffe(str(prototxt), f'{folder}/none.caffemodel')
            with self.assertRaisesRegex(revisit.UnsupportedError, "'onnx'"):
                dnn.readNet('a', 'b', 'onnx')
            with self.assertRaisesRegex(revisit.UsageError, 'found only'):
                dnn.readNet('a.caffemodel')


class Images(unittest.TestCase):
    image = (np.arange(4 * 6 * 3) * 7 % 251).astype(np.uint8).reshape(4, 6, 3)

    def test_blobs(self):
        self.assertEqual(dnn.blobFromImage(self.image, size=(4, 3))[0, 1].tolist(), [[33, 65, 96, 128], [76, 107, 139, 170], [118, 150, 181, 213]])
        self.assertEqual(dnn.blobFromImage(self.image, 0.5, (2, 2), (1, 2, 3), True, True).ravel().tolist(),
                         [43.5, 64.5, 44, 65, 39.5, 60.5, 40, 61, 35.5, 56.5, 36, 57])
        deep = self.image.astype(np.uint16) * 37 // 4
        self.assertEqual(dnn.blobFromImage(deep, size=(4, 3))[0, 1].tolist(), [[307, 599, 890, 1181], [700, 992, 1283, 1574], [1093, 1385, 1676, 1967]])
        self.assertEqual(dnn.blobFromImage(deep, size=(3, 2))[0, 1].tolist(), [[744, 1133, 1521], [754, 1142, 1530]])
        np.testing.assert_array_equal(dnn.blobFromImage(self.image, None, None, None), dnn.blobFromImage(self.image))
        blob = dnn.blobFromImages([self.image, self.image], ddepth=0)
        self.assertEqual((blob.dtype, blob.shape), (np.uint8, (2, 3, 4, 6)))
        self.assertEqual(dnn.imagesFromBlob(blob)[1].tolist(), self.image.tolist())
        with self.assertRaisesRegex(revisit.UsageError, 'was not read'):
            dnn.blobFromImage(None)
        for size, message in (((0, 3), 'at least 1'), ((-1, -1), 'at least 1')):
            with self.assertRaisesRegex(revisit.UsageError, message):
                dnn.blobFromImage(self.image, size=size)
        with self.assertRaisesRegex(revisit.UsageError, r'as many in each, found \[1, 3\]'):
            dnn.blobFromImages([self.image, self.image[:, :, 0]])
        with self.assertRaisesRegex(revisit.UsageError, 'uint8 needs'):
            dnn.blobFromImage(self.image, 0.5, ddepth=0)

    def test_boxes(self):
        boxes, scores = [(0, 0, 10, 10), (1, 1, 10, 10), (20, 20, 5, 5), (0, 0, 10, 10)], [0.6, 0.9, 0.5, 0.2]
        self.assertEqual(dnn.NMSBoxes(boxes, scores, 0.3, 0.4).tolist(), [1, 2])
        self.assertEqual(dnn.NMSBoxesBatched(boxes, scores, [0, 1, 0, 0], 0.3, 0.4).tolist(), [1, 0, 2])
        self.assertEqual(dnn.NMSBoxes([], [], 0.3, 0.4), ())
        with self.assertRaisesRegex(revisit.UsageError, '4 boxes and 1 scores'):
            dnn.NMSBoxes(boxes, [1], 0.3, 0.4)

    def test_models(self):
        net = conv_net()
        model = dnn.ClassificationModel(net)
        self.assertEqual(model.setInputScale(1 / 255).classify(np.full((40, 50, 3), 255, np.uint8)), (4, 1.0))
        model.setInputParams(None, (10, 8), None)
        model.setInputScale(None)
        self.assertEqual(model.classify(np.full((40, 50, 3), 255, np.uint8)), (4, 1.0))
        values = dnn.SegmentationModel(net).setOutputNames(['conv']).setInputSize(10, 8)
        self.assertEqual(values.segment(np.ones((40, 50, 3), np.uint8)).tolist(), np.full((8, 10), 3).tolist())
        frame = np.zeros((16, 20, 3), np.uint8)
        frame[8:10, 4:6] = 9
        points = dnn.KeypointsModel(net).setOutputNames(['conv']).estimate(frame, 0)
        self.assertEqual(points.tolist(), [[-1, -1], [4, 8], [4, 8]])
        detector = dnn.DetectionModel(network=net)
        self.assertFalse(detector.getNmsAcrossClasses())
        with self.assertRaisesRegex(revisit.UnsupportedError, 'Softmax; use predict'):
            detector.setNmsAcrossClasses(True).detect(frame)
        self.assertTrue(detector.getNmsAcrossClasses())
        self.assertFalse(model.getEnableSoftmaxPostProcessing())
        self.assertIs(model.setEnableSoftmaxPostProcessing(enable=True), model)
        self.assertTrue(model.getEnableSoftmaxPostProcessing())


def cv2_without_caffe():
    """Returns a module like cv2 of OpenCV 5."""
    names = {name: lambda *arguments, name=name: (name, arguments) for name in (
        'readNet', 'ClassificationModel', 'DetectionModel', 'KeypointsModel', 'Model', 'SegmentationModel')}
    return types.SimpleNamespace(dnn=types.SimpleNamespace(**names), dnn_registerLayer=lambda *arguments: arguments,
                                 dnn_unregisterLayer=lambda *arguments: arguments)


class Install(unittest.TestCase):
    def test_puts_caffe_into_cv2(self):
        cv2 = cv2_without_caffe()
        with mock.patch.dict(sys.modules, cv2=cv2), nets.folder_with(net=nets.SCALE) as folder:
            dnn.install()
            (folder / 'net.caffemodel').write_bytes(weights_of(nets.SCALE))
            files = str(folder / 'net.prototxt'), str(folder / 'net.caffemodel')
            for net in (cv2.dnn.readNetFromCaffe(*files), cv2.dnn.readNet(*files[::-1]), cv2.dnn.readNet(*map(Path, files)),
                        cv2.dnn.Model(model=files[1], config=Path(files[0]))._net):
                self.assertEqual(net.getLayerNames(), ('power',))
                self.assertIsInstance(cv2.dnn_DetectionModel(net), dnn.DetectionModel)
            self.assertEqual(cv2.dnn.readNet('a.onnx'), ('readNet', ('a.onnx',)))
            self.assertEqual(cv2.dnn.Model('a.onnx'), ('Model', ('a.onnx',)))
            self.assertEqual(cv2.dnn_registerLayer('Other', list), ('Other', list))
            self.assertEqual(cv2.dnn_unregisterLayer('Other'), ('Other',))
            self.assertIsNone(cv2.dnn_registerLayer('Crop', list))
            self.assertIsNone(cv2.dnn_unregisterLayer('Crop'))
            self.assertEqual(cv2.dnn_unregisterLayer('Crop'), ('Crop',))
            read = cv2.dnn.readNetFromCaffe
            dnn.install()
            self.assertIs(cv2.dnn.readNetFromCaffe, read)

    def test_runs_a_script(self):
        with tempfile.TemporaryDirectory() as folder:
            Path(folder, 'cv2.py').write_text('dnn_registerLayer = dnn_unregisterLayer = None\nclass dnn:\n    readNet = ClassificationModel = DetectionModel = KeypointsModel = Model '
                                              '= SegmentationModel = None\n')
            Path(folder, 'script.py').write_text('import cv2, sys\nprint(cv2.dnn.readNetFromCaffe.__module__, sys.argv[1])\n')
            done = subprocess.run([sys.executable, '-m', 'revisit.dnn', f'{folder}/script.py', 'word'], capture_output=True, text=True,
                                  env=os.environ | {'PYTHONPATH': f'{os.environ.get("PYTHONPATH", "")}:{folder}'})
        self.assertEqual(done.stdout, 'revisit.dnn._net word\n', done.stderr)


if __name__ == '__main__':
    unittest.main()
