"""revisit.dnn against OpenCV 4, whose cv2.dnn it replaces.

REVISIT_DNN_NETS names a folder of prototxts of public nets; they get random weights. docs/OPENCV.md lists those that were run.
"""

import os
import tempfile
import unittest
import warnings
from pathlib import Path

import numpy as np

try:
    import cv2
except ImportError:
    cv2 = None

from revisit import dnn, engine
from revisit._core.proto import net_of_layers

INPUT = 'input: "data" input_shape { dim: 1 dim: 4 dim: 13 dim: 17 }\n'
CONV = 'layer {{ name: "{0}" type: "Convolution" bottom: "{1}" top: "{0}" convolution_param {{ num_output: {2} kernel_size: 3 pad: 1 }} }}\n'
DETECTION = '''
layer { name: "loc" type: "Convolution" bottom: "data" top: "loc" convolution_param { num_output: 8 kernel_size: 1 } }
layer { name: "loc_perm" type: "Permute" bottom: "loc" top: "loc_perm" permute_param { order: 0 order: 2 order: 3 order: 1 } }
layer { name: "loc_flat" type: "Flatten" bottom: "loc_perm" top: "loc_flat" }
layer { name: "conf" type: "Convolution" bottom: "data" top: "conf" convolution_param { num_output: 6 kernel_size: 1 } }
layer { name: "conf_perm" type: "Permute" bottom: "conf" top: "conf_perm" permute_param { order: 0 order: 2 order: 3 order: 1 } }
layer { name: "conf_reshape" type: "Reshape" bottom: "conf_perm" top: "conf_reshape" reshape_param { shape { dim: 0 dim: -1 dim: 3 } } }
layer { name: "conf_softmax" type: "Softmax" bottom: "conf_reshape" top: "conf_softmax" softmax_param { axis: 2 } }
layer { name: "conf_flat" type: "Flatten" bottom: "conf_softmax" top: "conf_flat" }
layer { name: "priors" type: "PriorBox" bottom: "conf" bottom: "data" top: "priors"
        prior_box_param { min_size: 6 max_size: 8 clip: true variance: 0.1 variance: 0.1 variance: 0.2 variance: 0.2 offset: 0.5 } }
layer { name: "boxes" type: "DetectionOutput" bottom: "loc_flat" bottom: "conf_flat" bottom: "priors" top: "boxes"
        detection_output_param { num_classes: 3 share_location: true background_label_id: 0 nms_param { nms_threshold: 0.45 top_k: 100 }
        code_type: CENTER_SIZE keep_top_k: 20 confidence_threshold: %s } }
'''
# What OpenCV does with Caffe's layers, one case a rule.
NETS = {
    'in place': CONV.format('c', 'data', 6) + 'layer { name: "r" type: "ReLU" bottom: "c" top: "c" }\n'
                + CONV.format('d', 'c', 3),
    'a repeated name': 'layer { name: "r" type: "ReLU" bottom: "data" top: "a" }\nlayer { name: "r" type: "Power" bottom: "a" top: "b" '
                       'power_param { shift: 1 } }\n',
    'blobs of other names': 'layer { name: "s" type: "Slice" bottom: "data" top: "a" top: "b" slice_param { slice_point: 1 } }\n'
                            'layer { name: "p" type: "Pooling" bottom: "b" top: "q" pooling_param { kernel_size: 3 stride: 2 } }\n',
    'an unread second output': 'layer { name: "s" type: "Slice" bottom: "data" top: "a" top: "b" slice_param { slice_point: 1 } }\n'
                               'layer { name: "r" type: "ReLU" bottom: "a" top: "c" }\n',
    'pooling rounds up': 'layer { name: "p" type: "Pooling" bottom: "data" top: "p" pooling_param { kernel_size: 2 stride: 2 } }\n'
                         'layer { name: "q" type: "Pooling" bottom: "p" top: "q" pooling_param { pool: AVE kernel_size: 3 stride: 2 pad: 1 } }\n',
    'dropout': 'layer { name: "d" type: "Dropout" bottom: "data" top: "data" dropout_param { dropout_ratio: 0.9 } }\n' + CONV.format('c', 'data', 2),
    'crop': CONV.format('c', 'data', 3) + 'layer { name: "p" type: "Pooling" bottom: "data" top: "p" pooling_param { kernel_size: 2 stride: 2 } }\n'
            'layer { name: "k" type: "Crop" bottom: "c" bottom: "p" top: "k" crop_param { axis: 2 offset: 2 offset: 3 } }\n',
    'statistics of the pass': 'layer { name: "n" type: "BatchNorm" bottom: "data" top: "n" batch_norm_param { use_global_stats: false } }\n',
    'normalization': 'layer { name: "l" type: "LRN" bottom: "data" top: "l" lrn_param { local_size: 3 alpha: 0.5 } }\n'
                     'layer { name: "m" type: "MVN" bottom: "l" top: "m" }\n',
    'normalization within channels': 'layer { name: "w" type: "LRN" bottom: "data" top: "w" lrn_param { local_size: 3 alpha: 1 norm_region: '
                                     'WITHIN_CHANNEL } }\n',
    'names of convolutions': 'layer { name: "c" type: "Convolution" bottom: "data" top: "d" convolution_param { num_output: 2 kernel_size: 1 } }\n'
                             'layer { name: "e" type: "Silence" bottom: "d" }\n',
    'inner product and softmax': 'layer { name: "f" type: "InnerProduct" bottom: "data" top: "f" inner_product_param { num_output: 7 } }\n'
                                 'layer { name: "s" type: "Softmax" bottom: "f" top: "s" }\n',
    'deconvolution': 'layer { name: "u" type: "Deconvolution" bottom: "data" top: "u" convolution_param { num_output: 4 group: 4 '
                     'kernel_size: 4 stride: 2 pad: 1 } }\n',
    'scale and shape': 'layer { name: "k" type: "Scale" bottom: "data" top: "k" scale_param { bias_term: true } }\n'
                       'layer { name: "e" type: "Eltwise" bottom: "data" bottom: "k" top: "e" eltwise_param { operation: SUM coeff: 2 coeff: -1 } }\n'
                       'layer { name: "t" type: "Reshape" bottom: "e" top: "t" reshape_param { shape { dim: 0 dim: 2 dim: -1 } } }\n',
    'many detections': DETECTION % 0.01,
    'few detections': DETECTION % 0.99,
    'no detection': DETECTION % 0.9999,
    'clipped detections': (DETECTION % 0.01).replace('keep_top_k', 'clip: 1 keep_top_k'),
}


def write(path, weights):
    """Writes a caffemodel of names and weights."""
    layers = [(b'\n' + bytes([len(name)]) + name.encode(), [np.array(array, order='C') for array in arrays])
              for name, arrays in (weights or {'none': []}).items()]
    net_of_layers('net', layers).write_binary(path)


def with_random_weights(prototxt, caffemodel, seed=1):
    """Writes a caffemodel. Returns the shapes of the inputs."""
    net = engine.Net.load_with_random_weights(prototxt, seed, allow_unknown=True)
    weights = {name: [array.copy() for array in arrays] for name, arrays in net.weights.items()}
    heads = [name for name in weights if 'DetectionOutput' in prototxt.read_text() and name.endswith(('conf', 'loc'))]
    if heads:  # confidences that differ, and boxes within the image
        run = net.truncated(heads).plan().run()
        random = np.random.default_rng(seed)
        run.forward({name: random.normal(size=shape).astype(np.float32) for name, shape in run.plan.inputs.items()})
        for name in heads:
            for array in weights[name]:
                array *= (2.5 if name.endswith('conf') else 0.5) / run.output(name).std()
    write(caffemodel, weights)
    return net.inputs


def shape_to_run(shape):
    """One image, of at least 96 x 96 pixels if the prototxt leaves its size to the caller."""
    return (1, shape[1], *(96 if size < 8 else size for size in shape[2:])) if len(shape) == 4 else shape


def in_order(output):
    """Sorts detections by image, class and position, because rounding exchanges those of one confidence."""
    if output.ndim != 4 or output.shape[:2] != (1, 1) or output.shape[3] != 7:
        return output
    rows = output[0, 0]
    return rows[np.lexsort((rows[:, 3], rows[:, 1], rows[:, 0]))]


def relative_difference(a, b):
    return np.abs(a - b).max(initial=0) / max(np.abs(a).max(initial=0), 1e-30)


@unittest.skipUnless(cv2 and cv2.__version__ < '5', 'needs opencv-python-headless<5')
class AgainstOpenCv(unittest.TestCase):
    def setUp(self):
        warnings.simplefilter('ignore')
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = Path(folder.name)
        self.random = np.random.default_rng(1)

    def both(self, text, seed=1):
        """Returns the net in OpenCV and here, and the shapes of the inputs."""
        prototxt, caffemodel = self.folder / 'net.prototxt', self.folder / 'net.caffemodel'
        prototxt.write_text(text)
        shapes = with_random_weights(prototxt, caffemodel, seed)
        self.files = str(prototxt), str(caffemodel)
        return cv2.dnn.readNetFromCaffe(*self.files), dnn.readNetFromCaffe(*self.files), shapes

    def compare(self, theirs, ours, shapes, tolerance):
        names = [name for name in theirs.getLayerNames() if not name.endswith('/mvn')]  # BatchNorm of the pass is two layers there
        self.assertEqual(list(ours.getLayerNames()), names)
        self.assertEqual(ours.getUnconnectedOutLayersNames(), theirs.getUnconnectedOutLayersNames())
        blobs = {name: self.random.normal(size=shape_to_run(shape)).astype(np.float32) for name, shape in shapes.items()}
        worst = 0
        for names in (ours.getUnconnectedOutLayersNames(), ours.getLayerNames()):  # with layers fused, and all
            theirs = cv2.dnn.readNetFromCaffe(*self.files)  # after another forward() it has the weights of fused layers
            for name, blob in blobs.items():
                for net in (theirs, ours):
                    net.setInput(blob, name)
            for name, expected, found in zip(names, theirs.forward(names), ours.forward(names)):
                self.assertEqual(found.shape, expected.shape, name)
                difference = relative_difference(in_order(expected), in_order(found))
                self.assertLess(difference, tolerance, name)
                worst = max(worst, difference)
        return worst

    def test_nets(self):
        for rule, text in NETS.items():
            with self.subTest(rule):
                theirs, ours, shapes = self.both(INPUT + text)
                self.compare(theirs, ours, shapes, 3e-5)
                for name in ours.getLayerNames():
                    self.assertEqual(theirs.getLayerId(name) - ours.getLayerId(name), rule == 'statistics of the pass')
                    self.assertEqual(ours.getLayer(name).type, theirs.getLayer(name).type)
                theirs.setInput(np.zeros(shapes['data'], np.float32))
                for found, expected in zip(ours.forwardAndRetrieve(ours.getLayerNames()), theirs.forwardAndRetrieve(ours.getLayerNames())):
                    self.assertEqual([array.shape for array in found], [array.shape for array in expected[: len(found)]])

    def test_parameters_and_costs(self):
        text = NETS['scale and shape'] + NETS['inner product and softmax'] + CONV.format('c', 'data', 3)
        theirs, ours, _ = self.both(INPUT + text)
        for name in ('k', 'f', 'c'):
            for i in (0, 1):
                np.testing.assert_array_equal(ours.getParam(name, i), theirs.getParam(name, i))
        shape = (1, 4, 13, 17)
        self.assertEqual(ours.getMemoryConsumption(shape), theirs.getMemoryConsumption(shape))
        self.assertEqual(ours.getMemoryConsumption(1, shape), theirs.getMemoryConsumption(1, shape))
        self.assertLess(abs(ours.getFLOPS(shape) / theirs.getFLOPS(shape) - 1), 0.5)
        for given in (shape, [shape]):
            (numbers, *found), (their_numbers, *expected) = ours.getLayersShapes(given), theirs.getLayersShapes(given)
            np.testing.assert_array_equal(numbers, their_numbers, strict=True)
            self.assertEqual(repr(tuple(found)), repr(tuple(expected)))
        for number in (0, 1):
            self.assertEqual(ours.getLayer(number).type, theirs.getLayer(number).type)
            np.testing.assert_equal(ours.getLayer(number).blobs, theirs.getLayer(number).blobs)
        self.assertEqual(ours.getLayerTypes(), theirs.getLayerTypes())
        blob = self.random.normal(size=shape).astype(np.float32)
        for net in (theirs, ours):
            net.getLayer('c').blobs = [net.getParam('c') * 2]  # without a bias
            net.setInput(blob)
        self.assertLess(relative_difference(theirs.forward('c'), ours.forward('c')), 1e-5)

    def test_inputs(self):
        blob = self.random.integers(0, 256, (1, 4, 13, 17)).astype(np.uint8)
        for arguments in ((), ('data',), ('', None, None), ('', 0.5), ('data', 2.0, (1, 2, 3, 4)), ('', 1.0, 7)):
            for type_ in (np.uint8, np.float32, np.float64, np.int32):
                with self.subTest(arguments=arguments, type=type_):
                    theirs, ours, _ = self.both(INPUT + CONV.format('c', 'data', 2))
                    for net in (theirs, ours):
                        net.setInput(blob.astype(type_), *arguments)
                    self.assertLess(relative_difference(theirs.forward(), ours.forward(None)), 1e-5)

    def test_blobs(self):
        for case in range(60):
            channels = int(self.random.choice([1, 3, 4]))
            height, width, out_height, out_width = map(int, self.random.integers(2, 90, 4))
            if case % 5 == 0:
                height, width = 2 * out_height, 2 * out_width
            image = self.random.integers(0, 256, (height, width, channels)).astype(np.uint8)
            options = {'scalefactor': [1.0, 1 / 255, 0.017][case % 3], 'size': (out_width, out_height) if case % 7 else (0, 0),
                       'mean': [(), (104, 117, 123), (9, 8, 7, 6), 127.5][case % 4], 'swapRB': channels > 2 and bool(case % 2),
                       'crop': case % 3 == 0}
            with self.subTest(shape=image.shape, **options):
                expected, found = cv2.dnn.blobFromImage(image, **options), dnn.blobFromImage(image, **options)
                self.assertEqual(found.dtype, expected.dtype)
                np.testing.assert_allclose(found, expected, rtol=1e-6, atol=2e-5)
                smooth = image.astype(np.float32)
                np.testing.assert_allclose(dnn.blobFromImage(smooth, **options), cv2.dnn.blobFromImage(smooth, **options), atol=4e-3)
                for deep in (image.astype(np.uint16) * 257, image.astype(np.int16) * -37):  # rounded, as OpenCV does
                    expected, found = cv2.dnn.blobFromImage(deep, **options), dnn.blobFromImage(deep, **options)
                    self.assertLess(np.mean(~np.isclose(found, expected, rtol=1e-6, atol=1e-3 * options['scalefactor'])), 0.3)  # halves
                    np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1.001 * options['scalefactor'])
                np.testing.assert_array_equal(dnn.blobFromImage(image, None, None, None), cv2.dnn.blobFromImage(image, None, None, None))
        pair = [image, image[::-1].copy()]
        np.testing.assert_array_equal(dnn.blobFromImages(pair, ddepth=cv2.CV_8U), cv2.dnn.blobFromImages(pair, ddepth=cv2.CV_8U))
        for a, b in zip(dnn.imagesFromBlob(expected), cv2.dnn.imagesFromBlob(expected), strict=True):
            np.testing.assert_array_equal(a, b)

    def test_boxes(self):
        for case in range(30):
            n = int(self.random.integers(1, 60))
            boxes = self.random.integers(0, 40, (n, 4)).astype([int, float][case % 2]).tolist()
            scores = self.random.choice(np.linspace(0, 1, 20), n).tolist()
            for extra in ((), (0.9, 0), (1.0, 7)):
                np.testing.assert_array_equal(dnn.NMSBoxes(boxes, scores, 0.3, 0.6, *extra), cv2.dnn.NMSBoxes(boxes, scores, 0.3, 0.6, *extra))
            classes = self.random.integers(0, 3, n).tolist()
            np.testing.assert_array_equal(dnn.NMSBoxesBatched(boxes, scores, classes, 0.3, 0.4), cv2.dnn.NMSBoxesBatched(boxes, scores, classes, 0.3, 0.4))
        self.assertEqual(dnn.NMSBoxes([], [], 0.5, 0.4), cv2.dnn.NMSBoxes([], [], 0.5, 0.4))

    def models(self, kind, text, channels=4):
        theirs, ours, _ = self.both(INPUT + text)
        models = getattr(cv2.dnn, kind)(theirs), getattr(dnn, kind)(ours)
        for model in models:
            model.setInputParams(1 / 64, (17, 13), (100, 110, 120, 90), channels > 3)
        return *models, self.random.integers(0, 256, (40, 60, channels)).astype(np.uint8)

    def test_models(self):
        theirs, ours, image = self.models('ClassificationModel', NETS['inner product and softmax'])
        np.testing.assert_allclose(ours.classify(image), theirs.classify(image), rtol=1e-5)
        theirs, ours, image = self.models('SegmentationModel', CONV.format('c', 'data', 5))
        np.testing.assert_array_equal(ours.segment(image), theirs.segment(image))
        theirs, ours, image = self.models('KeypointsModel', CONV.format('c', 'data', 5))
        np.testing.assert_allclose(ours.estimate(image, 0.5), theirs.estimate(image, 0.5), rtol=1e-6)
        for rule in ('many detections', 'no detection'):
            theirs, ours, image = self.models('DetectionModel', NETS[rule])
            for found, expected in zip(ours.detect(image, 0.35), theirs.detect(image, 0.35)):
                np.testing.assert_allclose(found, expected, rtol=1e-5)
                self.assertEqual(getattr(found, 'dtype', tuple), getattr(expected, 'dtype', tuple))

    @unittest.skipUnless(os.environ.get('REVISIT_DNN_NETS'), 'REVISIT_DNN_NETS is not set')
    def test_public_nets(self):
        for file in sorted(Path(os.environ['REVISIT_DNN_NETS']).glob('*.prototxt')):
            with self.subTest(file.stem):
                try:
                    theirs, ours, shapes = self.both(file.read_text())
                    print(f'{file.stem}: {len(ours.getLayerNames())} layers, {self.compare(theirs, ours, shapes, 1e-4):.1e}', flush=True)
                except cv2.error as error:
                    print(f'{file.stem}: OpenCV fails: {str(error).splitlines()[0]}', flush=True)


if __name__ == '__main__':
    unittest.main()
