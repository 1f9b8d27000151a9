"""ONNX models of layers that are not in the zoo, and of other sizes than the exported one, against the engine."""

import itertools

import numpy as np

from conversion import compare, engine, onnx_export
from support import ConversionTest, input_layer, layer, numbers

# Name -> shape of the input, type and parameters of the layer, its weights, options.
LAYERS = {
    'axis of an inner product': ((2, 3, 4, 5), 'InnerProduct', 'inner_product_param { num_output: 6 axis: 2 }',
                                 [numbers(6, 20), numbers(6)]),
    'transposed': ((2, 12), 'InnerProduct', 'inner_product_param { num_output: 6 transpose: true bias_term: false }', [numbers(12, 6)]),
    'whole input as a vector': ((2, 12), 'InnerProduct', 'inner_product_param { num_output: 6 axis: 0 bias_term: false }',
                                [numbers(6, 24)]),
    'convolution along a line': ((2, 3, 9), 'Convolution', 'convolution_param { num_output: 4 kernel_size: 3 pad: 1 stride: 2 }',
                                 [numbers(4, 3, 3), numbers(4)]),
    'channels on a later axis': ((2, 2, 3, 9, 8), 'Convolution', 'convolution_param { num_output: 4 kernel_size: 3 axis: 2 }',
                                 [numbers(4, 3, 3, 3), numbers(4)]),
    'convolution without an image': ((2, 4), 'Convolution', 'convolution_param { num_output: 6 group: 2 }', [numbers(6, 2), numbers(6)]),
    'deconvolution without an image': ((3, 2, 4), 'Deconvolution', 'convolution_param { num_output: 5 kernel_size: 3 stride: 2 axis: -1 }',
                                       [numbers(4, 5), numbers(5)]),
    'depthwise': ((2, 4, 7, 8), 'ConvolutionDepthwise', 'convolution_param { num_output: 4 kernel_size: 3 bias_term: false }',
                  [numbers(4, 1, 3, 3)]),
    'kernel and pads by axis': ((1, 2, 9, 8), 'Convolution',
                                'convolution_param { num_output: 2 kernel_h: 1 kernel_w: 5 pad_h: 0 pad_w: 2 stride_h: 2 stride_w: 1 }',
                                [numbers(2, 2, 1, 5), numbers(2)]),
    'kernel larger than the image': ((1, 2, 4, 4), 'Convolution', 'convolution_param { num_output: 2 kernel_size: 5 stride: 3 }',
                                     [numbers(2, 2, 5, 5), numbers(2)], '--fixed'),
    'deconvolution': ((1, 4, 5, 6), 'Deconvolution', 'convolution_param { num_output: 6 group: 2 kernel_size: 3 stride: 2 pad: 1 dilation: 2 }',
                      [numbers(4, 3, 3, 3), numbers(6)]),
    'im2col': ((2, 3, 7, 6), 'Im2col', 'convolution_param { kernel_size: 3 pad: 1 stride: 2 }', []),
    'permute': ((2, 3, 4, 5), 'Permute', 'permute_param { order: 0 order: 2 }', []),
    'transpose': ((2, 3, 4, 5), 'Transpose', 'transpose_param { dim: 3 dim: 0 dim: 2 dim: 1 }', []),
    'reverse': ((2, 3, 4), 'Reverse', '', []),
    'reverse of two axes': ((2, 3, 4), 'Reverse', 'reverse_param { axis: 1 axis: -1 }', []),
    'flip': ((2, 3, 4, 5), 'Flip', 'flip_param { flip_height: true }', []),
    'flip of nothing': ((2, 3, 4, 5), 'Flip', 'flip_param { flip_width: false }', []),
    'flip of a signal': ((2, 3, 4), 'Flip', 'flip_param { flip_height: true }', []),
    'reorg': ((2, 8, 6, 4), 'Reorg', '', []),
    'reorg back': ((2, 18, 3, 2), 'Reorg', 'reorg_param { stride: 3 reverse: true }', []),
    'lstm of steps': ((5, 3, 2, 2), 'Lstm', 'lstm_param { num_output: 6 }', [numbers(24, 4), numbers(24, 6), numbers(24)]),
    'lstm of rows': ((6, 4), 'Lstm', 'lstm_param { num_output: 6 batch_size: 2 }', [numbers(24, 4), numbers(24, 6), numbers(24)]),
    'shuffled channels': ((2, 6, 4, 5), 'ShuffleChannel', 'shuffle_channel_param { group: 3 }', []),
    'flatten in the middle': ((2, 3, 4, 5), 'Flatten', 'flatten_param { axis: 1 end_axis: 2 }', []),
    'convolution with pads of sides': ((1, 2, 6, 7), 'Convolution', 'convolution_param { num_output: 3 kernel_size: 3 stride: 2 pad_r: 1 pad_t: 2 }',
                                       [numbers(3, 2, 3, 3), numbers(3)]),
    'deconvolution with pads of sides': ((1, 2, 4, 5), 'Deconvolution', 'convolution_param { num_output: 3 kernel_size: 3 stride: 2 pad_r: 1 pad_t: 1 }',
                                         [numbers(2, 3, 3, 3), numbers(3)]),
    'squeeze': ((2, 1, 3, 1), 'Squeeze', 'squeeze_param { axis: 1 axis: -1 }', []),
    'reshape in the middle': ((2, 6, 4, 5), 'Reshape', 'reshape_param { shape { dim: 3 dim: -1 } axis: 1 num_axes: 1 }', []),
    'depth to space': ((2, 8, 3, 4), 'DepthToSpace', 'depth_to_space_param { block_size: 2 data_format: "NCHW" }', []),
    'depth to space, channels first': ((2, 8, 3, 4), 'DepthToSpace', 'depth_to_space_param { block_size: 2 data_format: "CRD" }', []),
    'normalized by NormFace': ((2, 3, 4, 5), 'Normalize', 'normalize_param { normalize_type: "L2" }', []),
    'hard swish': ((2, 3, 4, 5), 'HardSwish', '', []),
    'normalized pixels': ((2, 3, 4, 5), 'Normalize', 'norm_param { across_spatial: false channel_shared: false }', [numbers(3)]),
    'normalized images': ((2, 3, 4, 5), 'Normalize', '', [np.float32(1.5)]),
    'numbers that are their own mean': ((2, 3), 'MVN', '', []),
    'statistics of the batch': ((3, 2, 4, 5), 'BatchNorm', 'batch_norm_param { use_global_stats: false }',
                                [numbers(2), numbers(2), numbers(1)]),
    'scale and bias of nvidia': ((3, 2, 4, 5), 'BatchNorm', 'batch_norm_param { scale_bias: true eps: 1e-7 }',
                                 [numbers(2), numbers(2, seed=1) ** 2, np.float32([9]), numbers(2, seed=3), numbers(2, seed=4)]),
    'bn of pspnet': ((2, 3, 4, 5), 'BN', 'bn_param { eps: 0.1 }', [numbers(1, 3, 1, 1, seed=seed) ** 2 for seed in range(4)]),
    'bn of segnet': ((2, 3, 4, 5), 'BN', 'bn_param { bn_mode: INFERENCE }', [numbers(1, 3, 1, 1), numbers(1, 3, 1, 1, seed=1)]),
    'bn of the batch': ((2, 3, 4, 5), 'BN', 'bn_param { bn_mode: LEARN }', [numbers(1, 3, 1, 1), numbers(1, 3, 1, 1, seed=1)]),
    'lrn of nothing': ((2, 6, 4, 5), 'LRN', 'lrn_param { alpha: 0 k: 2 }', []),
    'lrn that enlarges': ((2, 6, 4, 5), 'LRN', 'lrn_param { local_size: 3 alpha: 0.1 beta: -0.5 k: 1.5 }', []),
    'crop of both ends': ((2, 3, 7, 6), 'CropCenter', 'crop_center_param { crop_size: 0 crop_size: 1 crop_size: 2 crop_size: 0 }', []),
    'zoom': ((1, 2, 5, 6), 'Interp', 'interp_param { zoom_factor: 3 }', []),
    'shrink of a part': ((1, 2, 9, 11), 'Interp', 'interp_param { shrink_factor: 2 pad_beg: -1 pad_end: -2 }', []),
    'size of an image': ((1, 2, 5, 6), 'Interp', 'interp_param { height: 9 width: 4 }', []),
    'repeated pixels': ((1, 2, 3, 4), 'Upsample', 'upsample_param { scale: 3 }', []),
    'relu6': ((2, 3, 4, 5), 'ReLU6', 'relu6_param { negative_slope: 0.1 }', []),
    'mish': ((2, 3), 'Mish', '', []),
    'dropout that scales': ((2, 3), 'Dropout', 'dropout_param { dropout_ratio: 0.75 scale_train: false }', []),
    'hole': ((1, 2, 9, 9), 'Convolution', 'convolution_param { num_output: 2 kernel_size: 3 hole_h: 2 hole_w: 3 }',
             [numbers(2, 2, 3, 3), numbers(2)]),
    'prelu of a vector': ((2, 3), 'PReLU', '', [numbers(3)]),
    'sum of squares': ((2, 3, 4), 'Reduction', 'reduction_param { operation: SUMSQ axis: 1 coeff: 0.5 }', []),
    'several largest': ((2, 6, 3), 'ArgMax', 'argmax_param { top_k: 3 axis: 1 }', []),
    'pyramid': ((2, 3, 9, 13), 'SPP', 'spp_param { pyramid_height: 3 }', [], '--fixed'),
}


def recurrent(kind, n, gates, exposed=False, static=False):
    """Returns a recurrent layer with continuation indicators, as (text, weights, inputs)."""
    steps, streams, size = 5, 3, 4
    shapes = {'data': (steps, streams, size), 'cont': (steps, streams)}
    if static:
        shapes['static'] = (streams, 2)
    if exposed:
        shapes |= {f'state{i}': (1, streams, n) for i in range(2 if kind == 'LSTM' else 1)}
    text = ''.join(input_layer(*shape).replace('"data"', f'"{blob}"') for blob, shape in shapes.items())
    tops = ['y'] + [f'last{i}' for i in range(len(shapes) - 2 - static)]
    text += layer('cell', kind, list(shapes), tops,
                  f'recurrent_param {{ num_output: {n} expose_hidden: {str(exposed).lower()} }}')
    arrays = [numbers(gates * n, size), numbers(gates * n)] + ([numbers(gates * n, 2)] if static else []) + [numbers(gates * n, n, seed=1)]
    if kind == 'RNN':
        arrays += [numbers(n, n, seed=2), numbers(n, seed=3)]
    inputs = {blob: numbers(*shape, seed=i) for i, (blob, shape) in enumerate(shapes.items())}
    inputs['cont'] = (numbers(steps, streams, seed=9) > -0.5).astype(np.float32)
    return text, {'cell': arrays}, inputs


class Layers(ConversionTest):
    def test_against_the_engine_at_two_sizes(self):
        for name, (shape, kind, parameters, arrays, *options) in LAYERS.items():
            with self.subTest(name):
                prototxt, model = self.net(input_layer(*shape) + layer('it', kind, parameters=parameters), {'it': arrays} if arrays else {})
                printed = self.convert('onnx', prototxt, *([model] if arrays else []), self.path('net.onnx'),
                                       *options, tolerance=1e-5)
                self.assertIn('checked: ONNX Runtime', printed)
                if not options:
                    self.assertIn('another size', printed)

    def export(self, text, blobs, inputs, *options):
        prototxt, model = self.net(text, blobs)
        words = []
        for blob, array in inputs.items():
            np.save(self.path(f'{blob}.npy'), array)
            words += ['--input', f'{blob}={self.path(blob)}.npy']
        return self.convert('onnx', prototxt, *([model] if blobs else []), self.path('net.onnx'), *words, *options,
                            tolerance=1e-5)

    def test_recurrent(self):
        for kind, gates in (('LSTM', 4), ('RNN', 1)):
            for exposed, static in itertools.product((False, True), repeat=2):
                with self.subTest(kind, exposed=exposed, static=static):
                    self.export(*recurrent(kind, 6, gates, exposed, static))

    def test_lstm_that_clip_begins_anew(self):
        clip = input_layer(15, 1).replace('"data"', '"clip"')
        cell = layer('cell', 'Lstm', ['data', 'clip'], 'y', 'lstm_param { num_output: 6 }')
        self.export(input_layer(5, 3, 4) + clip + cell, {'cell': [numbers(24, 4), numbers(24, 6), numbers(24)]},
                    {'data': numbers(5, 3, 4), 'clip': (numbers(15, 1, seed=9) > -0.5).astype(np.float32)})

    def test_second_inputs(self):
        inputs = {'data': numbers(2, 3, 4, 5), 'other': numbers(2, 3, 1, 1, seed=1)}
        text = input_layer(2, 3, 4, 5) + input_layer(2, 3, 1, 1).replace('"data"', '"other"')
        self.export(text + layer('it', 'Mul', ['data', 'other']), {}, inputs)
        self.export(text + layer('it', 'Tile', ['data', 'other'], parameters='tile_param { tiles: 1 }'), {}, inputs)

    def test_masks_lead_back(self):
        pooling = layer('pool', 'Pooling', top=['pool', 'mask'], parameters='pooling_param { kernel_size: 3 stride: 2 pad: 1 }')
        back = layer('up', 'Upsample', ['pool', 'mask'], parameters='upsample_param { upsample_h: 9 upsample_w: 7 }')
        self.export(input_layer(2, 3, 9, 7) + pooling + back, {}, {'data': numbers(2, 3, 9, 7)}, '--fixed')
        whole = layer('pool', 'Pooling', top=['pool', 'mask'], parameters='pooling_param { global_pooling: true }')
        equal = np.round(numbers(2, 3, 9, 7))  # the first of equal values
        self.export(input_layer(2, 3, 9, 7) + whole + back, {}, {'data': equal}, '--fixed')
        for pad in (0, 1):  # the last windows are outside of the image: their index is -1
            gaps = layer('pool', 'Pooling', top=['pool', 'mask'], parameters=f'pooling_param {{ kernel_size: 2 stride: 4 pad: {pad} }}')
            self.export(input_layer(2, 3, 9, 7) + gaps, {}, {'data': equal})

    def test_a_constant_shape_after_a_computed_one(self):
        """ONNX Runtime 1.22 fuses two such reshapes and fails to load the result."""
        rows = layer('rows', 'InnerProduct', parameters='inner_product_param { num_output: 1 axis: -2 bias_term: false }')
        blobs, data = {'rows': [numbers(1, 30)]}, numbers(1, 8, 5, 6)
        vector = layer('vector', 'Reshape', 'rows', parameters='reshape_param { shape { dim: 1 dim: 8 } }')
        scale = layer('scale', 'Scale', ['data', 'vector'], parameters='scale_param { axis: 0 }')
        self.export(input_layer(1, 8, 5, 6) + rows + vector, blobs, {'data': data})
        self.export(input_layer(1, 8, 5, 6) + rows + vector + scale, blobs, {'data': data})

    def test_a_permutation_that_changes_nothing(self):
        """ONNX Runtime 1.22 would fuse it with Gemm as a matrix transposition."""
        product = layer('product', 'InnerProduct', parameters='inner_product_param { num_output: 1 bias_term: false }')
        self.export(input_layer(3, 5) + product + layer('it', 'Permute', 'product', parameters='permute_param { order: 0 }'),
                    {'product': [numbers(1, 5)]}, {'data': numbers(3, 5)})

    def test_channels_that_vary(self):
        """Channels are variable if they were the batch of an input."""
        turn = layer('turn', 'Permute', parameters='permute_param { order: 1 order: 0 order: 2 order: 3 }')
        for kind, parameters in (('ShuffleChannel', 'shuffle_channel_param { group: 2 }'), ('LRN', 'lrn_param { beta: -0.5 }'),
                                 ('Pooling', 'pooling_param { pool: AVE kernel_size: 1 stride: 3 }'),
                                 ('Im2col', 'convolution_param { kernel_size: 2 }')):
            prototxt, _ = self.net(input_layer(4, 1, 8, 9) + turn + layer('it', kind, 'turn', parameters=parameters), {})
            self.convert('onnx', prototxt, self.path('net.onnx'))
            model, inputs = onnx_export.Model(str(self.path('net.onnx'))), {'data': numbers(6, 1, 8, 9)}
            with self.subTest(kind):
                found = model.run(inputs, ['it'])
                self.assertLess(compare.difference(found['it'], engine.forward(prototxt, None, inputs)['it']), 1e-6)

    def test_statistics_of_many_numbers(self):
        parameters = 'batch_norm_param { use_global_stats: false }'
        data = np.maximum(numbers(4, 1, 60, 70), 0)
        self.export(input_layer(4, 1, 60, 70) + layer('it', 'BatchNorm', parameters=parameters), {'it': [numbers(1)] * 3},
                    {'data': data})

    def test_layers_beyond_the_end_are_ignored(self):
        beyond = layer('odd', 'Correlation', 'nowhere', parameters='correlation_param { pad: 1 }')
        text = input_layer(2, 3) + layer('it', 'AbsVal') + beyond
        self.export(text, {}, {'data': numbers(2, 3)}, '--end', 'it')

    def test_layers_in_place_change_all_blobs_in_the_memory(self):
        """Computed by hand: x + x of the rectified x; with Flatten, the second reader adds 1."""
        tail = layer('r', 'ReLU', 'f', 'f') + layer('y', 'Power', 'x', parameters='power_param { shift: 1 }')
        for middle, expected in (
                (layer('s', 'Split', 'x', ['f', 'b']) + layer('r', 'ReLU', 'f', 'f') + layer('it', 'Eltwise', ['f', 'b']), [0, 4, 0, 8]),
                (layer('f', 'Flatten', 'x') + tail + layer('it', 'Eltwise', ['f', 'y']), [1, 5, 1, 9])):
            data = {'data': np.array([[-1, 2, -3, 4]], np.float32)}
            self.export(input_layer(1, 4) + layer('x', 'Power') + middle, {}, data)
            self.assertEqual(onnx_export.Model(str(self.path('net.onnx'))).run(data, ['it'])['it'].tolist(), [expected])

    def test_several_inputs(self):
        two = input_layer(3, 2, 6, 7) + input_layer(3).replace('"data"', '"marks"')
        data, marks = numbers(3, 2, 6, 7), np.array([1, 0, 1], np.float32)
        self.export(two + layer('it', 'Filter', ['data', 'marks']), {}, {'data': data, 'marks': marks})
        self.export(two + layer('it', 'BatchReindex', ['data', 'marks']), {}, {'data': data, 'marks': marks})
        axpy = input_layer(3, 2, 1, 1).replace('"data"', '"a"') + input_layer(3, 2, 6, 7) + layer('it', 'Axpy', ['a', 'data', 'data'])
        self.export(axpy, {}, {'a': numbers(3, 2, 1, 1), 'data': data})
        rois = input_layer(3, 2, 6, 7) + input_layer(2, 5).replace('"data"', '"rois"') + layer(
            'it', 'ROIPooling', ['data', 'rois'], parameters='roi_pooling_param { pooled_h: 2 pooled_w: 3 spatial_scale: 0.5 }')
        self.export(rois, {}, {'data': data, 'rois': np.array([[0, 0, 0, 9, 7], [2, 3, 1, 13, 11]], np.float32)})
        boxes = input_layer(1, 2, 3, 4) + input_layer(1, 3, 30, 40).replace('"data"', '"image"') + layer(
            'it', 'PriorBox', ['data', 'image'], parameters='prior_box_param { min_size: 10 max_size: 20 aspect_ratio: 2 }')
        given = {'data': numbers(1, 2, 3, 4), 'image': numbers(1, 3, 30, 40)}
        self.export(boxes, {}, given, '--fixed')
        clustered = boxes.replace("PriorBox", "PriorBoxClustered").replace(
            'min_size: 10 max_size: 20 aspect_ratio: 2', 'width: 3 height: 5')
        self.export(clustered, {}, given, '--fixed')

    def test_pooling_at_every_size(self):
        text = input_layer(1, 2, 12, 17)
        windows = [(k, s, f'pad: {p}') for k in (1, 2, 3, 5) for s in (1, 2, 3, 4) for p in (0, 1, 2) if p < k]
        windows += [(k, s, f'pad_l: {l} pad_t: {l} pad_r: {r} pad_b: {r}') for k in (2, 3, 5) for s in (1, 2, 4) for l, r in ((0, 1), (1, 0))]
        modes = (('MAX', 'CEIL'), ('AVE', 'CEIL'), ('AVE', 'FLOOR'), ('AVE_EXC_PAD', 'CEIL'), ('AVE_EXC_PAD', 'FLOOR'))
        for i, (k, s, pads) in enumerate(windows):
            for pool, mode in modes:
                text += layer(f'{pool}_{mode}_{i}', 'Pooling', parameters=f'pooling_param {{ pool: {pool} kernel_size: {k} stride: {s} '
                                                                           f'{pads} round_mode: {mode} }}')
        prototxt, _ = self.net(text, {})
        self.convert('onnx', prototxt, self.path('net.onnx'), '--no-check')
        model = onnx_export.Model(str(self.path('net.onnx')))
        names = model.output_names()
        self.assertEqual(len(names), len(modes) * len(windows))
        for size in ((12, 17), (5, 6), (7, 8), (9, 10), (13, 11), (16, 19)):
            inputs = {'data': numbers(2, 2, *size)}
            expected = engine.forward(prototxt, None, inputs)
            found = model.run(inputs, names)
            for name in names:
                with self.subTest(name, size=size, window=windows[int(name.rsplit('_', 1)[1])]):
                    self.assertLess(compare.difference(found[name], expected[name]), 1e-6)
