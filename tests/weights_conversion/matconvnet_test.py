"""The command `matconvnet`, on files in the layout of vl_simplenn's documentation, written by SciPy."""

import struct
import subprocess
import sys
import unittest
from multiprocessing import get_context
from unittest import mock

import numpy as np
import scipy.io

from conversion import files, matconvnet
from revisit.errors import InputError
from support import ConversionTest, numbers


def cell(items):
    array = np.empty((1, len(items)), object)
    for i, item in enumerate(items):
        array[0, i] = item
    return array


def conv(name, h, w, inputs, outputs, pad=0, stride=1, **more):
    filters = numbers(h, w, inputs, outputs) / np.sqrt(np.float32(h * w * inputs))
    if outputs == 1:
        filters = filters[..., 0]  # as MATLAB stores it
    return dict(type='conv', name=name, weights=cell([filters, numbers(1, outputs)]), pad=np.atleast_2d(float(pad) if np.isscalar(pad) else pad),
                stride=np.atleast_2d(float(stride) if np.isscalar(stride) else stride), **more)


def pool(name, size, stride, pad=0.0, method='max'):
    return dict(type='pool', name=name, pool=np.array([[size, size]], float), stride=float(stride), pad=np.atleast_2d(pad), method=method)


class MatConvNet(ConversionTest):
    def save(self, layers, name='net.mat', wrap=False):
        """Writes a file. wrap: as `net` with `meta`, like newer files."""
        normalization = dict(imageSize=np.array([[31.0, 37, 3]]), averageImage=numbers(31, 37, 3))
        content = dict(layers=cell(layers), normalization=normalization)
        if wrap:
            content = dict(net=dict(layers=cell(layers), meta=dict(normalization=normalization)))
        scipy.io.savemat(self.path(name), content)
        return self.path(name)

    def run_command(self, layers, *options, **save):
        return self.convert('matconvnet', self.save(layers, **save), self.path('net.prototxt'), self.path('net.caffemodel'),
                            *options, tolerance=1e-5)

    def test_a_network_like_vgg_f(self):
        old = conv('conv2', 5, 5, 4, 12, [1, 1, 2, 2])  # groups, and fields from before 2015
        old |= dict(filters=old['weights'][0, 0], biases=old.pop('weights')[0, 1])
        moments = np.abs(numbers(12, 2)) + 0.5
        layers = [conv('conv1', 5, 5, 3, 8, 0, [2, 2]), dict(type='relu', name='relu1'),
                  dict(type='normalize', name='norm1', param=np.array([[5, 2, 1e-2, 0.75]])), pool('pool1', 3, 2, [0, 1, 0, 1]),
                  old, dict(type='relu', name='relu2', leak=0.1),
                  dict(type='bnorm', name='bn', weights=cell([numbers(12, 1), numbers(12, 1), moments])),
                  pool('pool2', 3, 2, method='avg'), dict(type='dropout', name='drop', rate=0.5),
                  conv('fc', 2, 3, 12, 1), dict(type='softmax', name='prob')]
        for options in ((), (self.path('mean.npy'), '--bgr')):
            for wrap in (False, True):
                self.assertIn('checked: the original and the engine', self.run_command(layers, *options, wrap=wrap))
        np.testing.assert_array_equal(files.read_mean(self.path('mean.npy')), numbers(31, 37, 3).transpose(2, 0, 1)[::-1])

    def test_a_bomb_is_not_unpacked(self):
        scipy.io.savemat(self.path('bomb.mat'), {'layers': np.zeros((1, 1 << 20))}, do_compression=True)
        self.refused(3, 'layer 1 has no type', 'matconvnet', self.path('bomb.mat'), self.path('o.prototxt'), self.path('o.caffemodel'))
        with mock.patch.object(files, 'FREE_BYTES', 1 << 20):
            self.refused(3, 'decompression bomb', 'matconvnet', self.path('bomb.mat'), self.path('o.prototxt'), self.path('o.caffemodel'))

    def test_files_that_crash_scipy_are_rejected(self):
        scipy.io.savemat(self.path('net.mat'), {'layers': np.arange(100.0)})
        content = self.path('net.mat').read_bytes()
        for kind in (8, 10, 11, 200, 1 << 20, 1 << 30):  # type of the numbers; 9 is double
            damaged = content.replace(struct.pack('<II', 9, 800), struct.pack('<II', kind, 800))
            self.assertNotEqual(damaged, content)
            self.path('bad.mat').write_bytes(damaged)
            done = subprocess.run([sys.executable, '-m', 'conversion', 'matconvnet', self.path('bad.mat'), self.path('o.prototxt'),
                                   self.path('o.caffemodel')], capture_output=True, text=True)
            self.assertEqual((done.returncode, done.stderr.count('\n')), (3, 1), f'{kind}: {done.stderr}')

    def test_a_worker_of_a_pool_may_read_one(self):
        scipy.io.savemat(self.path('net.mat'), {'layers': np.zeros(3)})
        with get_context('fork').Pool(1) as pool, self.assertRaisesRegex(InputError, 'layer 1 has no type'):
            pool.apply(matconvnet.load, [self.path('net.mat')])

    def test_pads_that_differ(self):
        for pad in ([0, 1, 0, 1], [1, 0, 1, 0], [2, 0, 0, 3], [1, 2, 3, 4]):
            for stride in (1, 2, 3):
                with self.subTest(pad=pad, stride=stride):
                    self.assertIn('by zeros', self.run_command([conv('it', 3, 4, 3, 2, pad, stride)]))

    def test_pooling_pads(self):
        for pad, method, size, stride in (([0, 0, 0, 0], 'max', 3, 2), ([0, 1, 0, 1], 'max', 3, 2), ([0, 1, 0, 1], 'avg', 2, 2),
                                          ([1, 1, 1, 1], 'max', 3, 1), ([1, 1, 1, 1], 'max', 3, 2), ([0, 0, 0, 0], 'avg', 3, 2)):
            with self.subTest(pad=pad, method=method):
                self.run_command([conv('c', 1, 1, 3, 2), pool('it', size, stride, pad, method)])

    def test_rejections(self):
        c = conv('c', 1, 1, 3, 2)
        cases = {'pads': pool('it', 3, 2, [1, 0, 1, 0]), 'rounding': pool('it', 3, 2, [0, 1, 0, 0]), 'average': pool('it', 3, 1, 1.0, 'avg'),
                 'group': dict(type='lrn', name='it', param=np.array([[4, 1, 1, 1]])), 'type': dict(type='pdist', name='it'),
                 'method': pool('it', 2, 2, 0.0, 'median'), 'moments': dict(type='bnorm', name='it', weights=cell([numbers(2, 1)] * 2))}
        for name, case in cases.items():
            with self.subTest(name):
                self.assertIn("layer 'it'", self.convert('matconvnet', self.save([c, case]), self.path('o.prototxt'), self.path('o.npz'), code=4))
        self.assertFalse(self.path('o.prototxt').exists())

    def test_files_that_cannot_be_read(self):
        file = self.save([conv('c', 1, 1, 3, 2)])
        content, outputs = file.read_bytes(), (self.path('o.prototxt'), self.path('o.caffemodel'))
        for n in (0, 10, 128, 300, len(content) // 2):
            self.path('cut.mat').write_bytes(content[:n])
            self.refused(3, 'cut.mat', 'matconvnet', self.path('cut.mat'), *outputs)
        scipy.io.savemat(self.path('other.mat'), dict(x=1))
        self.refused(3, 'expected a SimpleNN network', 'matconvnet', self.path('other.mat'), *outputs)
        bad = conv('c', 1, 1, 3, 2)
        bad['weights'] = cell([numbers(1, 1, 3, 2), numbers(5, 1)])
        self.refused(3, "layer 'c': filters of shape", 'matconvnet', self.save([bad]), *outputs)


if __name__ == '__main__':
    unittest.main()
