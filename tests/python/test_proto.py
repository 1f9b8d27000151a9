"""revisit.proto: network descriptions and weights."""

import gc
import tempfile
import unittest
from pathlib import Path

import numpy as np

import revisit
from nets import CONVOLVE, folder_with
from revisit import proto
from revisit.engine import Net

OLD = """
name: "old"
input: "data" input_dim: 1 input_dim: 2 input_dim: 4 input_dim: 4
layers { name: "conv" type: CONVOLUTION bottom: "data" top: "conv"
         convolution_param { num_output: 3 kernel_size: 1 } }
"""


def weights_for(shapes, seed=1):
    rng = np.random.default_rng(seed)
    return [rng.standard_normal(shape, np.float32) for shape in shapes]


class Descriptions(unittest.TestCase):
    def test_old_ones_are_upgraded(self):
        net = proto.parse_net(OLD)
        self.assertEqual(net.name, 'old')
        self.assertEqual(net.layers, [('input', 'Input'), ('conv', 'Convolution')])
        self.assertIn('type: "Convolution"', net.text())

    def test_errors_have_a_place(self):
        with self.assertRaisesRegex(revisit.InputError, r'^deploy:2:1: '):
            proto.parse_net('name: "x"\nnam: "y"', 'deploy')
        with self.assertRaisesRegex(revisit.InputError, 'limit of text'):
            proto.parse_net(OLD, limits=proto.Limits(text_bytes=10))

    def test_bytes_read_back(self):
        net = proto.parse_net(OLD)
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder, 'net')
            net.write_binary(file)
            self.assertEqual(proto.read_net_binary(file).text(), net.text())
            for wrong in (b'\xff\xff\xff', b'', b'\x89HDF\r\n\x1a\n'):
                file.write_bytes(wrong)
                with self.assertRaises(revisit.Error, msg=str(wrong)):
                    proto.read_net_binary(file)

    def test_schema_is_a_file_descriptor(self):
        self.assertIn(b'NetParameter', proto.schema())
        try:
            from google.protobuf import descriptor_pb2
        except ImportError:
            self.skipTest('protobuf for Python is not installed')
        schema = descriptor_pb2.FileDescriptorProto.FromString(proto.schema())
        self.assertEqual(schema.package, 'revisit.caffe')


class Weights(unittest.TestCase):
    def test_go_into_a_caffemodel_and_out_again(self):
        conv = weights_for([(4, 3, 3, 3), (4,)])
        fc = weights_for([(5, 80), (5,)], 2)
        with folder_with(net=CONVOLVE) as folder:
            net = proto.read_net(folder / 'net.prototxt')
            net.set_weights({'conv': conv, 'fc': fc})
            net.write_binary(folder / 'net.caffemodel')
            file = proto.WeightsFile(folder / 'net.caffemodel')
            loaded = Net.load(folder / 'net.prototxt', folder / 'net.caffemodel')
        by_name = {name: file.read(i) for i, (name, blobs) in enumerate(file.layers) if blobs}
        for name, expected in (('conv', conv), ('fc', fc)):
            for found in (by_name[name], loaded.weights[name]):
                for a, b in zip(found, expected, strict=True):
                    np.testing.assert_array_equal(a, b)

    def test_loads_from_memory(self):
        net = proto.parse_net(CONVOLVE)
        net.set_weights({'conv': weights_for([(4, 3, 3, 3), (4,)]), 'fc': weights_for([(5, 80), (5,)])})
        loaded = Net.load_from_memory(CONVOLVE, net.to_bytes())
        self.assertEqual(loaded.weights['fc'][0].shape, (5, 80))

    def test_file_in_memory_stays(self):
        net = proto.parse_net(CONVOLVE)
        net.set_weights({'conv': weights_for([(4, 3, 3, 3), (4,)])})
        file = proto.WeightsFile.from_bytes(net.to_bytes())
        gc.collect()
        self.assertEqual(file.layers[1], ('conv', 2))
        np.testing.assert_array_equal(file.read(1)[0], weights_for([(4, 3, 3, 3), (4,)])[0])
        with self.assertRaises(IndexError):
            file.read(99)

    def test_wrong_arrays_are_named(self):
        net = proto.parse_net(CONVOLVE)
        with self.assertRaisesRegex(TypeError, "layer 'conv'.*found float64 array of shape \\(4,\\)"):
            net.set_weights({'conv': [np.zeros(4)]})
        with self.assertRaisesRegex(ValueError, 'C order'):
            net.set_weights({'conv': [np.zeros((4, 6), np.float32)[:, ::2]]})
        with self.assertRaisesRegex(revisit.UsageError, "did you mean 'conv'"):
            net.set_weights({'conv1': []})

    def test_mean_image(self):
        # BlobProto: channels, height, width, packed data
        data = np.arange(6, dtype='<f4')
        blob = b'\x08\x01\x10\x01\x18\x02\x20\x03' + b'\x2a\x18' + data.tobytes()
        with folder_with() as folder:
            (folder / 'mean.binaryproto').write_bytes(blob)
            mean = proto.read_binaryproto(folder / 'mean.binaryproto')
        self.assertEqual(mean.shape, (1, 1, 2, 3))
        np.testing.assert_array_equal(mean.ravel(), data)


if __name__ == '__main__':
    unittest.main()
