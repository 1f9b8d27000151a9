"""ONNX models of layers that suppress boxes, against the engine."""

import numpy as np
import onnx

from conversion import onnx_export
from support import ConversionTest, input_layer, layer, numbers

PRIORS, CLASSES, IMAGES = 60, 4, 2

# Name -> parameters of DetectionOutput.
COMMON = 'num_classes: 4 confidence_threshold: 0.3 code_type: CENTER_SIZE'
SSD = {
    'default': f'{COMMON} nms_param {{ nms_threshold: 0.45 }}',
    'best of a class': f'{COMMON} nms_param {{ nms_threshold: 0.45 top_k: 9 }}',
    'best of an image': f'{COMMON} nms_param {{ nms_threshold: 0.6 }} keep_top_k: 5',
    'more than there are': f'{COMMON} nms_param {{ nms_threshold: 0.45 top_k: 400 }} keep_top_k: 2000',
    'threshold that keeps nothing': 'num_classes: 4 confidence_threshold: 2 nms_param { nms_threshold: 0.45 }',
    'no threshold': 'num_classes: 4 code_type: CENTER_SIZE nms_param { nms_threshold: 0.2 } keep_top_k: 20',
    'boxes of each class': f'{COMMON} share_location: false nms_param {{ nms_threshold: 0.3 }}',
    'no background': f'{COMMON} background_label_id: -1 share_location: false nms_param {{ nms_threshold: 0.3 }}',
    'background in the middle': f'{COMMON} background_label_id: 2 nms_param {{ nms_threshold: 0.3 }}',
    'variance in the network': f'{COMMON} variance_encoded_in_target: true nms_param {{ nms_threshold: 0.3 }}',
    'clipped': f'{COMMON} clip: true nms_param {{ nms_threshold: 0.45 }}',
    'corners': 'num_classes: 4 confidence_threshold: 0.3 nms_param { nms_threshold: 0.3 }',
    'corners in sizes': 'num_classes: 4 confidence_threshold: 0.3 code_type: CORNER_SIZE nms_param { nms_threshold: 0.3 }',
    'threshold that does not adapt': f'{COMMON} nms_param {{ nms_threshold: 0.45 eta: 0.5 }}',
}
YOLO = {
    'v2': ('YoloDetectionOutput', 'yolo_detection_output_param { num_classes: 3 num_box: 2 confidence_threshold: 0.3 '
           'biases: [1, 1.5, 2, 1] }', [(7, 7)]),
    'v2, two maps': ('YoloDetectionOutput', 'yolo_detection_output_param { num_classes: 3 num_box: 2 confidence_threshold: 0.3 '
                     'biases: [1, 1.5, 2, 1] }', [(7, 7), (3, 3)]),
    'v3': ('Yolov3DetectionOutput', 'yolov3_detection_output_param { num_classes: 3 num_box: 2 confidence_threshold: 0.3 '
           'biases: [20, 30, 40, 50, 90, 40] mask: [1, 2, 0, 1] mask_group_num: 2 anchors_scale: [16, 8] }', [(5, 4), (10, 8)]),
    'v3, nothing': ('Yolov3DetectionOutput', 'yolov3_detection_output_param { num_classes: 3 num_box: 1 confidence_threshold: 1 '
                    'biases: [20, 30] mask: 0 mask_group_num: 1 anchors_scale: 16 }', [(5, 4)]),
}


def named_input(name, *shape):
    return input_layer(*shape).replace('"data"', f'"{name}"')


class Detections(ConversionTest):
    def test_boxes_of_ssd_are_the_engines(self):
        for seed, (name, parameters) in enumerate(SSD.items()):
            with self.subTest(name):
                rows = self.rows(self.ssd(parameters, seed))
                self.assertEqual((rows[:, 1] == -1).all(), name == 'threshold that keeps nothing')
                self.assertEqual(set(rows[:, 0]), {0, 1})

    def test_boxes_of_yolo_are_the_engines(self):
        for name, (kind, parameters, maps) in YOLO.items():
            with self.subTest(name):
                anchors = 1 if 'nothing' in name else 2
                inputs = {f'map{i}': numbers(1, anchors * 8, *size, seed=i) for i, size in enumerate(maps)}
                text = ''.join(named_input(blob, *array.shape) for blob, array in inputs.items())
                net = self.files(text + layer('boxes', kind, list(inputs), parameters=parameters), inputs)
                self.assertEqual((self.rows(net)[:, 1] == -1).all(), 'nothing' in name)

    def test_a_whole_detector(self):
        def convolution(name, outputs):
            return layer(name, 'Convolution', parameters=f'convolution_param {{ num_output: {outputs} kernel_size: 8 }}') + \
                layer(f'{name}_flat', 'Flatten', name)
        text = (input_layer(1, 3, 8, 8) + convolution('loc', 4) + convolution('conf', 2)
                + layer('prior', 'PriorBox', ['loc', 'data'], parameters='prior_box_param { min_size: 4 }')
                + layer('boxes', 'DetectionOutput', ['loc_flat', 'conf_flat', 'prior'],
                        parameters='detection_output_param { num_classes: 2 nms_param { nms_threshold: 0.5 } }'))
        prototxt, model = self.net(text, {'loc': [numbers(4, 3, 8, 8), numbers(4)], 'conf': [numbers(2, 3, 8, 8), numbers(2)]})
        self.refused(4, 'export with --fixed', 'onnx', prototxt, model, self.path('net.onnx'))
        printed = self.convert('onnx', prototxt, model, self.path('net.onnx'), '--fixed')
        self.assertIn("boxes: 1 of 1 rows of the engine are among ONNX Runtime's 1", printed)
        self.assertEqual(onnx_export.Model(str(self.path('net.onnx'))).output_names(), ['boxes'])
        sizes = onnx.load(self.path('net.onnx')).graph.output[0].type.tensor_type.shape.dim
        self.assertEqual([dim.dim_value for dim in sizes], [0] * 4)  # the number of boxes is not known

    def test_what_onnx_cannot_do_is_refused(self):
        for message, nms in (('eta below 1', 'nms_threshold: 0.7 eta: 0.5'), ('nms_threshold: expected 0 to 1', 'nms_threshold: 1.5')):
            prototxt, words, _ = self.ssd(f'num_classes: 4 nms_param {{ {nms} }}', 0)
            self.refused(4, message, 'onnx', prototxt, self.path('net.onnx'), '--fixed', *words)

    def ssd(self, parameters, seed):
        random = np.random.default_rng(seed)
        corner = random.uniform(0, 0.7, (PRIORS, 2))
        boxes = np.hstack([corner, corner + random.uniform(0.1, 0.3, (PRIORS, 2))])
        prior = np.stack([boxes, np.tile([0.1, 0.1, 0.2, 0.2], (PRIORS, 1))]).reshape(1, 2, -1)
        sets = 1 if 'share_location: false' not in parameters else CLASSES
        inputs = {'loc': numbers(IMAGES, PRIORS * sets * 4, seed=seed) / (1 if 'CENTER' in parameters else 5),
                  'conf': random.dirichlet(np.ones(CLASSES), (IMAGES, PRIORS)).reshape(IMAGES, -1), 'prior': prior}
        text = ''.join(named_input(blob, *array.shape) for blob, array in inputs.items())
        return self.files(text + layer('boxes', 'DetectionOutput', list(inputs),
                                       parameters=f'detection_output_param {{ {parameters} }}'), inputs)

    def files(self, text, inputs):
        """Returns the prototxt, options that give the inputs, and the inputs."""
        prototxt, _ = self.net(text, {})
        words = []
        for blob, array in inputs.items():
            np.save(self.path(f'{blob}.npy'), array.astype(np.float32))
            words += ['--input', f'{blob}={self.path(blob)}.npy']
        return prototxt, words, {blob: array.astype(np.float32) for blob, array in inputs.items()}

    def rows(self, net):
        """Exports the net, which compares the rows with the engine's, and returns ONNX Runtime's."""
        prototxt, words, inputs = net
        printed = self.convert('onnx', prototxt, self.path('net.onnx'), '--fixed', *words, tolerance=1e-6)
        self.assertIn("checked: layer 'boxes' with the engine's inputs", printed)
        rows = onnx_export.Model(str(self.path('net.onnx'))).run(inputs, ['boxes'])['boxes'].reshape(-1, 7)
        self.assertRegex(printed, f'boxes: {len(rows)} of {len(rows)} rows')
        return rows
