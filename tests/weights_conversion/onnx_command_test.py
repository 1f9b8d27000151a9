"""The command `onnx`: truncation, names, float16, errors."""

import numpy as np
import onnx

from conversion import compare, onnx_export
from support import ConversionTest, input_layer, layer, numbers

NET = (input_layer(1, 3, 14, 16) + layer('conv1', 'Convolution', parameters='convolution_param { num_output: 4 kernel_size: 3 }')
       + layer('relu1', 'ReLU', 'conv1', 'conv1')
       + layer('conv2', 'Convolution', 'conv1', parameters='convolution_param { num_output: 5 kernel_size: 3 }')
       + layer('relu2', 'ReLU', 'conv2', 'conv2')
       + layer('pool', 'Pooling', 'conv2', parameters='pooling_param { kernel_size: 3 stride: 2 }')
       + layer('prob', 'Softmax', 'pool'))
BLOBS = {'conv1': [numbers(4, 3, 3, 3), numbers(4)], 'conv2': [numbers(5, 4, 3, 3), numbers(5)]}


class Command(ConversionTest):
    def setUp(self):
        super().setUp()
        self.prototxt, self.model = self.net(NET, BLOBS)
        self.onnx = self.path('net.onnx')

    def outputs(self, *options):
        self.convert('onnx', self.prototxt, self.model, self.onnx, *options)
        return onnx_export.Model(str(self.onnx)).output_names()

    def test_truncation_as_in_the_engine(self):
        self.assertEqual(self.outputs(), ['prob'])
        self.assertEqual(self.outputs('--end', 'conv1'), ['conv1'])
        self.assertEqual(self.outputs('--end', 'relu1'), ['relu1'])
        self.assertEqual(self.outputs('--end', 'conv1+pool'), ['conv1+pool'])
        self.refused(2, "has no layer or blob 'conv3' (did you mean 'conv", 'onnx', self.prototxt, self.model, self.onnx, '--end', 'conv3')
        self.refused(2, "has no layer 'pol' (did you mean 'pool'?)", 'onnx', self.prototxt, self.model, self.onnx,
                     '--end', 'conv1+pol')

    def test_sizes_are_free_unless_fixed(self):
        for options, is_free in ((), True), (('--fixed',), False):
            self.outputs(*options)
            sizes = [bool(dim.dim_param) for dim in onnx.load(self.onnx).graph.input[0].type.tensor_type.shape.dim]
            self.assertEqual(sizes, [is_free, False, is_free, is_free])

    def test_float16_takes_half_the_space(self):
        blobs = {'fc': [numbers(64, 3 * 14 * 16)]}
        text = input_layer(1, 3, 14, 16) + layer('fc', 'InnerProduct', parameters='inner_product_param { num_output: 64 bias_term: false }')
        prototxt, model = self.net(text, blobs, 'fc')
        sizes = []
        for options in ((), ('--float16',)):
            self.convert('onnx', prototxt, model, self.onnx, *options)
            sizes.append(self.onnx.stat().st_size)
        self.assertLess(sizes[1], 0.52 * sizes[0])
        _, large = self.net(text, {'fc': [blobs['fc'][0] * 1e6]}, 'large')
        self.refused(1, "layer 'fc': expected weights up to", 'onnx', prototxt, large, self.onnx, '--float16')

    def test_npz_as_weights(self):
        self.convert('weights', self.model, self.path('net.npz'))
        self.convert('onnx', self.prototxt, self.path('net.npz'), self.onnx)

    def test_a_wrong_model_fails_the_check(self):
        expected = {'y': numbers(2, 3)}
        for wrong in ({'y': numbers(2, 3) + np.float32(0.1)}, {'y': numbers(3, 2)}, {}, {'y': np.full((2, 3), np.nan, np.float32)}):
            with self.assertRaises(compare.CheckFailed):
                compare.require('it', wrong, expected, 1e-4)
        compare.require('it', {'y': numbers(2, 3)}, expected, 0)

    def test_a_detector_of_fields_is_exported_up_to_its_boxes(self):
        net = input_layer(1, 3, 8, 8) + layer('conv', 'Convolution', parameters='convolution_param { num_output: 6 kernel_size: 1 }') + \
            layer('boxes', 'BoxOutput', 'conv', parameters='box_output_param { field_w: 8 field_h: 8 downsample_rate: 8 }')
        blobs = {'conv': [numbers(6, 3, 1, 1), numbers(6)]}
        prototxt, model = self.net(net, blobs)
        printed = self.convert('onnx', prototxt, model, self.onnx)
        self.assertIn("note: layer 'boxes' (BoxOutput) cannot be exported to ONNX; the model ends before it, with the outputs conv;", printed)
        self.assertEqual(onnx_export.Model(str(self.onnx)).output_names(), ['conv'])
        self.refused(4, "layer 'boxes' (BoxOutput)", 'onnx', prototxt, model, self.onnx, '--end', 'boxes')
        # If other layers read its input, the net cannot be truncated before it.
        prototxt, model = self.net(net + layer('prob', 'Softmax', 'conv'), blobs, 'read_twice')
        self.refused(4, "layer 'boxes' (BoxOutput)", 'onnx', prototxt, model, self.onnx, '--fixed')

    def test_shapes_of_inputs_are_written_with_x_or_commas(self):
        for shape in ('2x3x15x17', '2,3,15,17', 'data=2,3,15,17'):
            self.convert('onnx', self.prototxt, self.model, self.onnx, '--fixed', '--input', shape)
            sizes = [dim.dim_value for dim in onnx.load(self.onnx).graph.input[0].type.tensor_type.shape.dim]
            self.assertEqual(sizes, [2, 3, 15, 17])

    def test_rejections(self):
        prototxt, _ = self.net(input_layer(1, 3, 8, 8) + layer('spp', 'SPP', parameters='spp_param { pyramid_height: 2 }'), {}, 'spp')
        self.refused(4, "layer 'spp' (SPP)", 'onnx', prototxt, self.onnx)
        self.refused(4, "'it' (Nonsense)", 'onnx', self.net(input_layer(1) + layer('it', 'Nonsense'), {}, 'no')[0], self.onnx)
        regions = self.path('regions.npy')
        np.save(regions, np.zeros((2, 5), np.float32))
        rois = input_layer(1, 4, 3, 3) + input_layer(2, 5).replace('"data"', '"rois"')
        for kind, parameters in (('ROIPooling', 'roi_pooling_param { pooled_h: 1 pooled_w: 1 pad_ratio: 0.5 }'),
                                 ('PSROIPooling', 'psroi_pooling_param { spatial_scale: 1 output_dim: 1 group_size: 2 }')):
            prototxt, _ = self.net(rois + layer('pool', kind, ['data', 'rois'], parameters=parameters), {}, kind)
            self.refused(4, f"layer 'pool' ({kind})", 'onnx', prototxt, self.onnx, '--input', f'rois={regions}')
        embed = input_layer(3) + layer('embed', 'Embed', parameters='embed_param { num_output: 2 input_dim: 5 bias_term: false }')
        prototxt, model = self.net(embed, {'embed': [numbers(5, 2)]}, 'embed')
        self.refused(2, '--input data=FILE.npy', 'onnx', prototxt, model, self.onnx)
        self.assertFalse(self.onnx.exists())

    def test_files_that_cannot_be_read(self):
        self.refused(3, 'cannot open', 'onnx', self.path('none.prototxt'), self.model, self.onnx)
        self.refused(3, 'cannot open', 'onnx', self.prototxt, self.path('none.caffemodel'), self.onnx)
        content = self.model.read_bytes()
        for n in (0, 1, 10, len(content) // 2, len(content) - 1):
            self.path('cut.caffemodel').write_bytes(content[:n])
            self.convert('onnx', self.prototxt, self.path('cut.caffemodel'), self.onnx, code=3)
        self.path('text.prototxt').write_text('layer { name: "data"')
        self.convert('onnx', self.path('text.prototxt'), self.model, self.onnx, code=3)
        self.assertFalse(self.onnx.exists())

    def test_outputs_are_not_overwritten_unasked(self):
        self.onnx.write_text('mine')
        self.refused(2, 'already exists', 'onnx', self.prototxt, self.model, self.onnx)
        self.assertEqual(self.onnx.read_text(), 'mine')
        self.refused(2, 'must end in .onnx', 'onnx', self.prototxt, self.model, self.path('net.txt'))
