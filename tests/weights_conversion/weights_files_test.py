"""The commands `weights` and `mean`."""

import io
import os
import struct
import subprocess
import sys
import unittest
import warnings
import zipfile
from unittest import mock

import h5py
import numpy as np

from conversion import engine, files, weights
from revisit.caffe.proto import caffe_pb2 as messages
from support import GOLDEN, ConversionTest, input_layer, layer, numbers

TEXT = input_layer(1, 3, 5, 6) + layer('a/1x1', 'Convolution', parameters='convolution_param { num_output: 2 kernel_size: 1 }')
BLOBS = {'a/1x1': [numbers(2, 3, 1, 1), numbers(2)]}


class Weights(ConversionTest):
    def setUp(self):
        super().setUp()
        self.prototxt, self.model = self.net(TEXT, BLOBS)

    def test_an_error_leaves_the_callers_output_alone(self):
        program = "from conversion.__main__ import main; print('a'); main(['mean', 'in.npy', 'x' * 300 + '.npy']); print('b')"
        done = subprocess.run([sys.executable, '-c', program], capture_output=True, text=True)
        self.assertEqual((done.returncode, done.stdout), (0, 'a\nb\n'), done.stderr)
        for output in ("open('/dev/full', 'w')", "type('Odd', (io.StringIO,), {'flush': lambda self: open('')})()"):
            program = ('import io, sys; from conversion.__main__ import main; '
                       f"sys.stdout = {output}; print(main(['mean', 'x', 'y' * 300])); sys.stdout = sys.__stdout__; print('b')")
            done = subprocess.run([sys.executable, '-c', program], capture_output=True, text=True)
            self.assertEqual((done.stdout[-2:], done.stderr.count('Traceback')), ('b\n', 0), done.stderr)

    def test_round_trip_keeps_every_bit(self):
        first = self.model
        for name in ('net.h5', 'net.npz', 'other.h5', 'other.caffemodel'):
            self.convert('weights', first, self.path(name))
            first = self.path(name)
        self.assertEqual(weights.read(first).keys(), BLOBS.keys())
        weights.require_same(weights.read(first), BLOBS)

    def test_hdf5_is_in_caffes_layout(self):
        self.assertIn("the original Caffe cannot read layer 'a/1x1'", self.convert('weights', self.model, self.path('net.h5')))
        with h5py.File(self.path('net.h5')) as file:
            np.testing.assert_array_equal(file['data/a/1x1/0'], BLOBS['a/1x1'][0])
            self.assertEqual(file['data/a/1x1/1'].dtype, np.float32)
        inputs = {'data': numbers(1, 3, 5, 6)}
        np.testing.assert_array_equal(engine.forward(self.prototxt, self.path('net.h5'), inputs)['a/1x1'],
                                      engine.forward(self.prototxt, self.model, inputs)['a/1x1'])

    def test_files_of_every_generation(self):
        """Outputs of Caffe are equal for all files, so arrays must be equal, too."""
        folder = GOLDEN / 'formats'
        expected = weights.read(folder / 'mini_v2.caffemodel')
        for name in ('mini_v0', 'mini_v1', 'mini_v1_shape', 'mini_v2_legacydims', 'mini_v2_unpacked', 'mini_v2_unknown_fields'):
            with self.subTest(name):
                self.convert('weights', folder / f'{name}.caffemodel', self.path('old.h5'))
                weights.require_same(weights.read(self.path('old.h5')), expected)

    def test_numbers_as_bytes(self):
        """Weights as written by NVIDIA's fork and OpenCV's shrinkCaffeModel()."""
        path, values = self.path('raw.caffemodel'), np.float16([[1, -2.5], [0.1, 65504]])
        for number, kind in enumerate(('<f8', '<f4', '<f2', '<i4')):
            net = messages.NetParameter()
            blob = net.layer.add(name='a', type='InnerProduct').blobs.add(
                raw_data_type=number, raw_data=values.astype(kind).tobytes())
            blob.shape.dim.extend(values.shape)
            path.write_bytes(net.SerializeToString())
            if number < 3:
                np.testing.assert_array_equal(weights.read(path)['a'][0], values.astype(np.float32))
            else:
                with self.assertRaisesRegex(weights.InputError, 'raw_data_type 3'):
                    weights.read(path)

    def test_float16(self):
        self.convert('weights', self.model, self.path('half.npz'), '--float16')
        with np.load(self.path('half.npz')) as file:
            self.assertEqual(file['a/1x1/0'].dtype, np.float16)
        rounded = weights.read(self.path('half.npz'))['a/1x1'][0]
        np.testing.assert_array_equal(rounded, BLOBS['a/1x1'][0].astype(np.float16).astype(np.float32))
        self.refused(2, '--float16: expected an .npz output', 'weights', self.model, self.path('half.h5'), '--float16')

    def test_files_that_cannot_be_read(self):
        out = self.path('out.caffemodel')
        self.refused(3, 'cannot open', 'weights', self.path('none.npz'), out)
        self.refused(2, 'must end in', 'weights', self.model, self.path('net.txt'))
        self.convert('weights', self.model, self.path('net.npz'))
        content = self.path('net.npz').read_bytes()
        for n in (0, 3, 100, len(content) - 30):
            self.path('cut.npz').write_bytes(content[:n])
            self.refused(3, 'not a readable npz', 'weights', self.path('cut.npz'), out)
        np.savez(self.path('keys.npz'), weights=numbers(2))
        self.refused(3, "found 'weights'", 'weights', self.path('keys.npz'), out)
        np.savez(self.path('objects.npz'), **{'a/0': np.array([{}])})
        self.refused(3, 'npz', 'weights', self.path('objects.npz'), out)
        self.assertFalse(out.exists())

    def test_archives_of_strangers(self):
        """All exceptions of zipfile and its decompressors, and decompression bombs."""
        out, file = self.path('out.caffemodel'), self.path('bad.npz')
        head = io.BytesIO()
        np.lib.format.write_array(head, np.zeros(1000, np.float32))

        def archive(*entries):
            with warnings.catch_warnings(), zipfile.ZipFile(file, 'w', zipfile.ZIP_DEFLATED) as opened:
                warnings.simplefilter('ignore')
                for name, content in entries:
                    opened.writestr(name, content)
            return bytearray(file.read_bytes())
        archive(('a/0.npy', b'text'))
        self.refused(3, 'is not an array', 'weights', file, out)
        archive(('a/0.npy', head.getvalue()), ('a/0.npy', head.getvalue()))
        self.refused(3, "duplicate entry 'a/0'", 'weights', file, out)
        self.refused(3, "duplicate entry 'a/0'", 'torch', 'alexnet', file, self.path('o.prototxt'), out)
        whole = archive(('a/0.npy', head.getvalue()))
        for old, new in ((b'\x14\0\0\0\x08\0', b'\x14\0\0\0\x63\0'), (b'\x14\0\0\0\x08\0', b'\x14\0\1\0\x08\0'),
                         (whole[37:43], b'\xff' * 6)):
            file.write_bytes(whole.replace(old, new))
            self.refused(3, 'not a readable npz file', 'weights', file, out)
            self.refused(3, 'not a readable npz file', 'torch', 'alexnet', file, self.path('o.prototxt'), out)
        for shape in ('(10000000000000,)', '(4294967296, 4294967296)', '(-1,)', '(' * 3000, "__import__('os').abort()"):
            text = f"{{'descr': '<f4', 'fortran_order': False, 'shape': {shape}, }}\n".encode()
            archive(('a/0.npy', b'\x93NUMPY\1\0' + struct.pack('<H', len(text)) + text + bytes(8)))
            self.refused(3, 'not a readable npz file', 'weights', file, out)
        with mock.patch.object(files, 'FREE_BYTES', 1 << 20):
            archive(('a/0.npy', bytes(2 << 20)))
            self.refused(3, 'decompression bomb', 'weights', file, out)

    def test_streams_may_be_closed(self):
        for words in (['--help'], ['weights', self.model, self.path('net.npz')]):
            words = [sys.executable, '-m', 'conversion', *words]
            with open('/dev/full', 'w') as full:
                done = subprocess.run(words, stdout=full, stderr=subprocess.PIPE, text=True)
            if '--help' not in words:  # some versions of argparse ignore the error
                self.assertEqual((done.returncode, done.stderr), (1, 'revisit-convert: [Errno 28] No space left on device\n'))
            self.assertNotIn('Traceback', done.stderr)
            self.path('net.npz').unlink(missing_ok=True)
            reads, writes = os.pipe()
            os.close(reads)
            done = subprocess.run(words, stdout=writes, stderr=subprocess.PIPE, text=True)
            os.close(writes)
            self.assertEqual(done.stderr, '')
        self.refused(3, r'\x1b[2J.npz: cannot open', 'weights', self.path('\x1b[2J.npz'), self.path('out.caffemodel'))


class Means(ConversionTest):
    def test_there_and_back(self):
        np.save(self.path('mean.npy'), numbers(3, 4, 5))
        self.convert('mean', self.path('mean.npy'), self.path('mean.binaryproto'))
        self.convert('mean', self.path('mean.binaryproto'), self.path('again.npy'))
        np.testing.assert_array_equal(np.load(self.path('again.npy')), numbers(3, 4, 5))

    def test_files_of_caffe(self):
        folder = GOLDEN / 'formats'
        expected = files.read_mean(folder / 'mean.npy')
        for name in ('mean_legacy', 'mean_shape'):
            np.testing.assert_array_equal(files.read_mean(folder / f'{name}.binaryproto'), expected)

    def test_files_that_cannot_be_read(self):
        out = self.path('out.npy')
        for content in (b'', b'\xff\xff', messages.BlobProto(num=1, channels=2, height=1, width=1, data=[1]).SerializeToString(),
                        messages.BlobProto(num=-1, channels=-1, height=1, width=1, data=[1]).SerializeToString()):
            self.path('bad.binaryproto').write_bytes(content)
            self.refused(3, 'not a', 'mean', self.path('bad.binaryproto'), out)
        self.path('bad.npy').write_bytes(b'\x93NUMPY')
        self.refused(3, 'not a readable npy', 'mean', self.path('bad.npy'), out)
        np.save(self.path('flat.npy'), numbers(3, 4))
        self.refused(3, '[channels][height][width]', 'mean', self.path('flat.npy'), out)


if __name__ == '__main__':
    unittest.main()
