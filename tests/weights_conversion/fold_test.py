
import numpy as np

from conversion import weights
from support import ConversionTest, input_layer, layer, numbers

NORM = [numbers(4, seed=1), np.abs(numbers(4, seed=2)) + 0.1, [2.0]]
SCALE = [numbers(4, seed=3), numbers(4, seed=4)]


class Fold(ConversionTest):
    def fold(self, text, blobs, code=0):
        prototxt, model = self.net(text, blobs)
        printed = self.convert('fold', prototxt, model, self.path('out.prototxt'), self.path('out.caffemodel'),
                               code=code, tolerance=1e-6)
        return printed, (weights.read(self.path('out.caffemodel')) if code == 0 else None)

    def test_in_place_and_not(self):
        conv = layer('conv', 'Convolution', parameters='convolution_param { num_output: 4 kernel_size: 3 bias_term: false }')
        product = layer('conv', 'InnerProduct', parameters='inner_product_param { num_output: 4 transpose: true }')
        scale = 'scale_param { bias_term: true }'
        followers = {
            'in place': layer('bn', 'BatchNorm', 'conv', 'conv') + layer('sc', 'Scale', 'conv', 'conv', scale),
            'own blobs': layer('bn', 'BatchNorm', 'conv', 'b') + layer('sc', 'Scale', 'b', 's', scale),
            'norm alone': layer('bn', 'BatchNorm', 'conv', 'b'),
            'scale and bias': layer('bn', 'BatchNorm', 'conv', 'b', 'batch_norm_param { scale_filler { value: 1 } }'),
        }
        for start, arrays in (conv, [numbers(4, 3, 3, 3)]), (product, [numbers(3 * 6 * 7, 4), numbers(4)]):
            for name, text in followers.items():
                with self.subTest(name, start=start):
                    blobs = {'conv': arrays, 'bn': NORM} | ({'sc': SCALE} if 'Scale' in text else {})
                    if name == 'scale and bias':
                        blobs['bn'] = NORM + SCALE
                    last = {'in place': 'conv', 'own blobs': 's'}.get(name, 'b')
                    printed, folded = self.fold(input_layer(2, 3, 6, 7) + start + text + layer('relu', 'ReLU', last), blobs)
                    self.assertEqual(list(folded), ['conv'])
                    self.assertIn('checked: folded and original', printed)
                    self.assertNotIn('BatchNorm', self.path('out.prototxt').read_text())

    def test_kept_layers(self):
        conv = input_layer(2, 3, 6, 7) + layer('conv', 'Convolution', parameters='convolution_param { num_output: 4 kernel_size: 3 }')
        blobs = {'conv': [numbers(4, 3, 3, 3), numbers(4)], 'bn': NORM, 'sc': SCALE}
        read_twice = layer('bn', 'BatchNorm', 'conv', 'b') + layer('sum', 'Eltwise', ['conv', 'b'])
        after_relu = layer('relu', 'ReLU', 'conv', 'conv') + layer('bn', 'BatchNorm', 'conv', 'b')
        of_batch = layer('bn', 'BatchNorm', 'conv', 'b', 'batch_norm_param { use_global_stats: false }')
        seen = layer('split', 'Split', 'conv', ['a', 'b']) + layer('bn', 'BatchNorm', 'a', 'a') + layer('relu', 'ReLU', 'b')
        for text in (read_twice, after_relu, of_batch, seen):
            with self.subTest(text):
                printed, _ = self.fold(conv + text, blobs, code=4)
                self.assertIn('no BatchNorm that is the only reader', printed)

    def test_others_see_the_memory(self):
        conv = layer('conv', 'Convolution', parameters='convolution_param { num_output: 4 kernel_size: 3 }')
        text = input_layer(2, 3, 6, 7) + conv + layer('bn', 'BatchNorm', 'conv', 'conv') + layer('flat', 'Flatten', 'conv') \
            + layer('relu', 'ReLU', 'flat', 'flat') + layer('sum', 'Power', 'conv')
        _, folded = self.fold(text, {'conv': [numbers(4, 3, 3, 3), numbers(4)], 'bn': NORM})
        self.assertEqual(list(folded), ['conv'])

    def test_bottoms_that_are_not_written(self):
        printed, _ = self.fold(input_layer(1, 3, 6, 7) + layer('relu', 'ReLU', 'date'), {'x': [[1]]}, code=3)
        self.assertIn("bottom 'date' is not written by an earlier layer (did you mean 'data'?)", printed)

    def test_variance_that_cannot_be(self):
        text = input_layer(1, 3, 6, 7) + layer('conv', 'Convolution', parameters='convolution_param { num_output: 4 kernel_size: 3 }') \
            + layer('bn', 'BatchNorm', 'conv', 'b')
        printed, _ = self.fold(text, {'conv': [numbers(4, 3, 3, 3), numbers(4)], 'bn': [NORM[0], [-1, 1, 1, 1], [1]]}, code=3)
        self.assertIn('not finite', printed)
