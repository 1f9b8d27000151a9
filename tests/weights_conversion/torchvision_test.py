"""The command `torch`. Compares outputs with PyTorch and torchvision if they are installed."""

import importlib.util
import pickle
import sys
import unittest
from types import SimpleNamespace
from unittest import mock

import numpy as np
from safetensors.numpy import save_file

from conversion import weights
from support import ConversionTest, numbers

HAS_TORCH = all(importlib.util.find_spec(name) for name in ('torch', 'torchvision'))


def squeezenet1_1():
    shapes = {'features.0': (64, 3, 3, 3), 'classifier.1': (1000, 512, 1, 1)}
    inputs = 64
    for n, squeeze, expand in ((3, 16, 64), (4, 16, 64), (6, 32, 128), (7, 32, 128), (9, 48, 192), (10, 48, 192), (11, 64, 256), (12, 64, 256)):
        shapes |= {f'features.{n}.squeeze': (squeeze, inputs, 1, 1), f'features.{n}.expand1x1': (expand, squeeze, 1, 1),
                   f'features.{n}.expand3x3': (expand, squeeze, 3, 3)}
        inputs = 2 * expand
    state = {}
    for key, shape in shapes.items():
        state[f'{key}.weight'] = numbers(*shape) / np.sqrt(np.float32(np.prod(shape[1:])))
        state[f'{key}.bias'] = numbers(shape[0])
    return state


class Torchvision(ConversionTest):
    def setUp(self):
        super().setUp()
        self.outputs = (self.path('net.prototxt'), self.path('net.caffemodel'))

    def save(self, state, name='state.safetensors'):
        save_file(state, self.path(name))
        return self.path(name)

    def test_a_network_without_torch(self):
        state = squeezenet1_1()
        printed = self.convert('torch', 'squeezenet1_1', self.save(state), *self.outputs, '--input', '1x3x63x80')
        self.assertIn('checked' if HAS_TORCH else 'not compared', printed)
        read = weights.read(self.outputs[1])
        self.assertEqual(2 * len(read), len(state))
        np.testing.assert_array_equal(read['features.3.expand3x3'][0], state['features.3.expand3x3.weight'])

    def test_state_dicts_that_do_not_fit(self):
        state = squeezenet1_1()
        self.refused(2, "unknown network 'resnet19'", 'torch', 'resnet19', self.save(state), *self.outputs)
        self.refused(3, "expected the key 'conv1.weight'", 'torch', 'resnet18', self.save(state), *self.outputs)
        self.refused(3, "found 'more.weight'", 'torch', 'squeezenet1_1', self.save(state | {'more.weight': numbers(3)}),
                     *self.outputs)
        del state['features.9.squeeze.weight']
        self.refused(3, "expected the key 'features.9.squeeze.weight'", 'torch', 'squeezenet1_1', self.save(state), *self.outputs)
        state = squeezenet1_1() | {'features.9.squeeze.weight': numbers(48, 100, 1, 1)}
        self.refused(3, "'features.9.squeeze.weight': shape", 'torch', 'squeezenet1_1', self.save(state), *self.outputs)
        self.assertFalse(self.outputs[0].exists())

    def test_files_that_cannot_be_read(self):
        content = self.save(squeezenet1_1()).read_bytes()
        for n in (0, 5, 100, len(content) // 2):
            self.path('cut.safetensors').write_bytes(content[:n])
            self.refused(3, 'cut.safetensors', 'torch', 'squeezenet1_1', self.path('cut.safetensors'), *self.outputs)
        self.path('cut.npz').write_bytes(b'PK')
        self.refused(3, 'not a readable npz', 'torch', 'squeezenet1_1', self.path('cut.npz'), *self.outputs)

    def test_no_code_is_run(self):
        class Hostile:
            def __reduce__(self):
                return (open, (str(ran), 'w'))
        ran = self.path('ran')
        self.path('state.pth').write_bytes(pickle.dumps({'a': Hostile()}))
        code, words = (3, 'with numbers only') if HAS_TORCH else (1, 'needs PyTorch')
        self.refused(code, words, 'torch', 'alexnet', self.path('state.pth'), *self.outputs)
        self.assertFalse(ran.exists())

    def test_a_torch_that_may_run_code_is_not_asked(self):
        self.path('state.pth').touch()
        for version, code, words in (('1.13.1', 1, 'expected PyTorch 2.6 or later'), ('2.5.1+cpu', 1, 'found 2.5.1+cpu'),
                                     ('2.6.0', 3, 'was read'), ('2.10.0a0+git1', 3, 'was read')):
            torch = SimpleNamespace(__version__=version, load=mock.Mock(side_effect=ValueError('was read')))
            with self.subTest(version), mock.patch.dict(sys.modules, {'torch': torch}):
                self.refused(code, words, 'torch', 'alexnet', self.path('state.pth'), *self.outputs)

    @unittest.skipUnless(HAS_TORCH, 'PyTorch and torchvision are not installed')
    def test_against_torchvision(self):
        import torch
        import torchvision
        torch.manual_seed(0)
        for name, options in (('squeezenet1_0', ()), ('resnet18', ()), ('mobilenet_v2', ('--bgr',)), ('googlenet_transform_input', ())):
            more = dict(init_weights=True) if name.startswith('googlenet') else {}
            model = getattr(torchvision.models, name.removesuffix('_transform_input'))(weights=None, **more)
            for module in model.modules():
                if isinstance(module, torch.nn.BatchNorm2d):
                    module.running_mean.normal_(0, 0.1)
                    module.running_var.uniform_(0.5, 2)
            torch.save(model.state_dict(), self.path('state.pth'))
            with self.subTest(name):
                self.assertIn('checked', self.convert('torch', name, self.path('state.pth'), *self.outputs,
                                                      '--input', '1x3x97x131', *options, tolerance=1e-5))


if __name__ == '__main__':
    unittest.main()
