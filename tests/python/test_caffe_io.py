"""revisit.caffe.io and related classes, against values computed by hand."""

import tempfile
import unittest
from pathlib import Path

import numpy as np
from google.protobuf.message import DecodeError

import caffe_needs  # noqa: F401

import revisit.caffe as caffe
from folders import FolderTest
from revisit.caffe import io
from revisit.caffe.proto import caffe_pb2

try:
    from PIL import Image
except ImportError:
    Image = None


def picture(*shape):
    return np.random.default_rng(len(shape)).random(shape, np.float32)


class Resizing(unittest.TestCase):
    def test_smaller_takes_the_pixels_at_the_middles(self):
        line = np.array([0, 1, 2, 3, 4, 5], np.float32).reshape(1, 6, 1)
        # Centers of thirds: 0.5, 2.5, 4.5; of quarters: 0.25, 1.75, 3.25, 4.75.
        np.testing.assert_allclose(
            io.resize_image(line, (1, 3)).ravel(), [0.5, 2.5, 4.5], atol=1e-6
        )
        np.testing.assert_allclose(
            io.resize_image(line, (1, 4)).ravel(), [0.25, 1.75, 3.25, 4.75], atol=1e-6
        )

    def test_larger_fades_to_the_darkest_value_at_the_edge(self):
        line = np.array([1, 3], np.float32).reshape(1, 2, 1)
        # At -0.25, 0.25, 0.75, 1.25: a quarter of the first and last pixel is outside of the image, where the value is 1.
        np.testing.assert_allclose(
            io.resize_image(line, (1, 4)).ravel(), [1, 1.5, 2.5, 2.5], atol=1e-6
        )

    def test_rows_and_columns(self):
        image = np.array([[0, 4], [8, 12]], np.float32)[:, :, np.newaxis]
        np.testing.assert_allclose(io.resize_image(image, (1, 1)), [[[6]]], atol=1e-6)
        tall = io.resize_image(np.repeat(image, 3, axis=2), (2, 1))
        np.testing.assert_allclose(tall[:, 0, 1], [2, 10], atol=1e-6)

    def test_other_numbers_of_channels_keep_their_corners(self):
        image = np.array([0, 2, 4], np.float32).reshape(1, 3, 1) * np.ones((2, 1, 4), np.float32)
        np.testing.assert_allclose(
            io.resize_image(image, (2, 5))[0, :, 3], [0, 1, 2, 3, 4], atol=1e-6
        )
        for size, labels in [(2, [0, 4]), (5, [0, 2, 2, 4, 4]), (1, [0])]:
            found = io.resize_image(image, (2, size), interp_order=0)
            np.testing.assert_array_equal(found[1, :, 2], labels)

    def test_one_value_stays(self):
        np.testing.assert_array_equal(
            io.resize_image(np.full((3, 3, 3), 7.5), (2, 9)), np.full((2, 9, 3), 7.5)
        )

    def test_like_scikit_image_without_blur(self):
        try:
            from skimage.transform import resize
        except ImportError:
            self.skipTest('scikit-image is not installed')
        for shape, size in [((37, 51, 3), (12, 60)), ((20, 20, 1), (47, 13)), ((9, 8, 3), (9, 16))]:
            image = picture(*shape)
            low, high = image.min(), image.max()
            for order in (0, 1):
                expected = resize(
                    (image - low) / (high - low),
                    size,
                    order=order,
                    mode='constant',
                    anti_aliasing=False,
                )
                found = io.resize_image(image, size, interp_order=order)
                np.testing.assert_allclose(
                    found, expected * (high - low) + low, atol=2e-6, err_msg=f'{shape} {order}'
                )

    def test_like_scipy_with_other_numbers_of_channels(self):
        try:
            from scipy.ndimage import zoom
        except ImportError:
            self.skipTest('scipy is not installed')
        image = picture(17, 23, 5)
        for size in [(34, 46), (9, 12)]:
            for order in (0, 1, 3):
                expected = zoom(image, (size[0] / 17, size[1] / 23, 1), order=order)
                found = io.resize_image(image, size, interp_order=order)
                np.testing.assert_allclose(found, expected, atol=1e-5)

    def test_rejects_other_arrays(self):
        for image, size in [
            (np.zeros((3, 3)), (2, 2)),
            (np.zeros((0, 3, 3)), (2, 2)),
            (np.zeros((3, 3, 3)), (0, 2)),
        ]:
            with self.assertRaises(ValueError):
                io.resize_image(image, size)


class Transforming(unittest.TestCase):
    def setUp(self):
        self.transformer = io.Transformer({'data': (10, 3, 2, 2)})

    def test_order_of_operations(self):
        t = self.transformer
        t.set_input_scale('data', 0.5)
        t.set_mean('data', np.array([1, 2, 3]))
        t.set_raw_scale('data', 255)
        t.set_channel_swap('data', (2, 1, 0))
        t.set_transpose('data', (2, 0, 1))
        image = picture(2, 2, 3)
        before = image.copy()
        out = t.preprocess('data', image)
        self.assertEqual((out.shape, out.dtype), ((3, 2, 2), np.float32))
        with self.assertRaisesRegex(ValueError, r"'data': expected an image with the channels .2, 1, 0., found 0"):
            t.preprocess('data', image[..., :0])
        for channel in range(3):  # BGR: channel 0 is blue, the image's last channel
            expected = (image[:, :, 2 - channel] * 255 - (channel + 1)) * 0.5
            np.testing.assert_allclose(out[channel], expected, rtol=1e-5)
        np.testing.assert_array_equal(image, before)
        np.testing.assert_allclose(t.deprocess('data', out), image, atol=1e-6)

    def test_nothing_set(self):
        image = picture(2, 2, 3)
        np.testing.assert_array_equal(self.transformer.preprocess('data', image), image)

    def test_resizes_to_the_input(self):
        image = np.zeros((4, 4, 3))
        image[:2, 2:] = 1
        out = self.transformer.preprocess('data', image)
        np.testing.assert_allclose(out[:, :, 0], [[0, 1], [0, 0]], atol=1e-6)

    def test_means(self):
        self.transformer.set_transpose('data', (2, 0, 1))
        image = np.full((2, 2, 3), 5.0)
        mean = np.arange(12, dtype=float).reshape(3, 2, 2)
        self.transformer.set_mean('data', mean)
        np.testing.assert_allclose(self.transformer.preprocess('data', image), 5 - mean)
        large = np.repeat(np.repeat(mean, 2, axis=1), 2, axis=2)  # [3][4][4]
        self.transformer.set_mean('data', large)
        np.testing.assert_allclose(self.transformer.preprocess('data', image), 5 - mean, atol=1e-5)
        self.transformer.set_mean('data', np.array([[1.0, 2], [3, 4]]))
        np.testing.assert_allclose(self.transformer.preprocess('data', image)[2], [[4, 3], [2, 1]])
        for wrong in [np.zeros(2), np.zeros((1, 3, 2, 2))]:
            with self.assertRaises(ValueError):
                self.transformer.set_mean('data', wrong)

    def test_wrong_arguments(self):
        for call in (
            lambda: self.transformer.preprocess('label', picture(2, 2, 3)),
            lambda: self.transformer.set_transpose('data', (1, 0)),
            lambda: self.transformer.set_channel_swap('data', (1, 0)),
        ):
            with self.assertRaises(ValueError):
                call()


class Crops(unittest.TestCase):
    def test_corners_middle_and_mirrors(self):
        image = np.arange(5 * 7, dtype=np.float32).reshape(5, 7, 1)
        crops = io.oversample([image, -image], (3, 3))
        self.assertEqual(crops.shape, (20, 3, 3, 1))
        np.testing.assert_array_equal(crops[:5, 0, 0, 0], [0, 4, 14, 18, 9])
        np.testing.assert_array_equal(crops[5:10], crops[:5, :, ::-1])
        np.testing.assert_array_equal(crops[10:], -crops[:10])
        with self.assertRaises(ValueError):
            io.oversample([image], (6, 3))


@unittest.skipIf(Image is None, 'pillow is not installed')
class Files(unittest.TestCase):
    def load(self, image, name='image.png', **options):
        with tempfile.TemporaryDirectory() as folder:
            image.save(Path(folder) / name)
            return io.load_image(str(Path(folder) / name), **options)

    def test_color(self):
        pixels = np.array([[[255, 0, 51], [0, 102, 0]]], np.uint8)
        loaded = self.load(Image.fromarray(pixels))
        self.assertEqual(loaded.dtype, np.float32)
        np.testing.assert_allclose(loaded, pixels / 255, rtol=1e-6)
        gray = self.load(Image.fromarray(pixels), color=False)
        np.testing.assert_allclose(gray.ravel(), [0.2125 + 0.0721 * 0.2, 0.7154 * 0.4], rtol=1e-5)

    def test_gray(self):
        pixels = np.array([[0, 51], [102, 255]], np.uint8)
        self.assertEqual(self.load(Image.fromarray(pixels), color=False).shape, (2, 2, 1))
        loaded = self.load(Image.fromarray(pixels))
        for channel in range(3):
            np.testing.assert_allclose(loaded[:, :, channel], pixels / 255, rtol=1e-6)
        deep = Image.fromarray(np.array([[0, 65535]], np.uint16))
        np.testing.assert_allclose(self.load(deep)[0, :, 0], [0, 1])

    def test_transparency_and_palettes(self):
        pixels = np.array([[[255, 0, 51, 0], [0, 102, 0, 128]]], np.uint8)
        np.testing.assert_allclose(
            self.load(Image.fromarray(pixels)), pixels[:, :, :3] / 255, rtol=1e-6
        )
        colors = Image.fromarray(pixels[:, :, :3]).convert('P', palette=Image.Palette.ADAPTIVE)
        np.testing.assert_allclose(self.load(colors), pixels[:, :, :3] / 255, rtol=1e-6)


class Messages(unittest.TestCase):
    def test_blobs(self):
        array = np.arange(24, dtype=np.float32).reshape(2, 3, 4)
        blob = io.array_to_blobproto(array, diff=-array)
        self.assertEqual(list(blob.shape.dim), [2, 3, 4])
        blob = caffe_pb2.BlobProto.FromString(blob.SerializeToString())
        np.testing.assert_array_equal(io.blobproto_to_array(blob), array)
        np.testing.assert_array_equal(io.blobproto_to_array(blob, return_diff=True), -array)
        old = caffe_pb2.BlobProto(num=1, channels=2, height=3, width=4, data=range(24))
        self.assertEqual(io.blobproto_to_array(old).shape, (1, 2, 3, 4))
        several = io.arraylist_to_blobprotovector_str([array, array[0]])
        self.assertEqual(
            [a.shape for a in io.blobprotovector_str_to_arraylist(several)], [(2, 3, 4), (3, 4)]
        )
        with self.assertRaises(ValueError):
            io.blobproto_to_array(caffe_pb2.BlobProto(data=[1, 2]))
        self.assertEqual(list(io.array_to_blobproto([[1, 2]]).data), [1, 2])
        self.assertEqual(len(io.array_to_blobproto(np.ones((1,) * 40)).shape.dim), 40)

    def test_datums(self):
        pixels = np.arange(24, dtype=np.uint8).reshape(2, 3, 4)
        for array in (pixels, pixels / 7):
            datum = io.array_to_datum(array, label=3)
            self.assertEqual((datum.label, bool(datum.data)), (3, array.dtype == np.uint8))
            found = io.datum_to_array(caffe_pb2.Datum.FromString(datum.SerializeToString()))
            np.testing.assert_allclose(found, array, rtol=1e-6)
            self.assertEqual(found.dtype, array.dtype)
        self.assertFalse(io.array_to_datum(pixels).HasField('label'))
        with self.assertRaises(ValueError):
            io.array_to_datum(pixels[0])
        with self.assertRaises(ValueError):
            io.array_to_datum([1, 2])

    def test_mean_files(self):
        formats = Path(__file__).parents[1] / 'golden/formats'
        expected = np.load(formats / 'mean.npy')
        for name in ('mean_legacy.binaryproto', 'mean_shape.binaryproto'):
            blob = caffe_pb2.BlobProto()
            blob.ParseFromString((formats / name).read_bytes())
            np.testing.assert_array_equal(io.blobproto_to_array(blob).squeeze(), expected.squeeze())

    def test_texts(self):
        from google.protobuf import text_format

        labels = text_format.Parse(
            'item { name: "none" label: 0 display_name: "background" } item { label: 1 }',
            caffe_pb2.LabelMap(),
        )
        self.assertEqual([item.label for item in labels.item], [0, 1])
        solver = text_format.Parse(
            'net: "x.prototxt" solver_mode: CPU base_lr: 0.1', caffe_pb2.SolverParameter()
        )
        self.assertEqual(solver.solver_mode, caffe_pb2.SolverParameter.CPU)
        self.assertEqual((caffe_pb2.TRAIN, caffe_pb2.TEST), (0, 1))
        self.assertEqual(caffe_pb2.NetParameter.DESCRIPTOR.full_name, 'caffe.NetParameter')

    def test_nets_of_other_forks(self):
        """Number 149 is a message here, and a word in another fork."""
        layer = caffe_pb2.LayerParameter(name='c', type='ReLU').SerializeToString() + b'\xaa\x09\x07Ternary'
        data = b'\xa2\x06' + bytes([len(layer)]) + layer
        net = caffe_pb2.NetParameter.FromString(data)
        self.assertEqual([each.name for each in net.layer], ['c'])
        again = caffe_pb2.NetParameter()
        again.ParseFromString(data)
        self.assertEqual(again, net)
        with self.assertRaises(DecodeError):
            again.ParseFromString(b'\xff')

    def test_beside_an_original_caffe(self):
        from google.protobuf import descriptor_pb2, descriptor_pool

        file = descriptor_pb2.FileDescriptorProto(name='caffe.proto', package='caffe')
        file.message_type.add(name='NetParameter')
        descriptor_pool.Default().AddSerializedFile(file.SerializeToString())
        original = descriptor_pool.Default().FindMessageTypeByName('caffe.NetParameter')
        self.assertEqual(len(original.fields), 0)
        self.assertTrue(caffe_pb2.NetParameter(name='ours').HasField('name'))


AVERAGE = """
layer { name: "data" type: "Input" top: "data" input_param { shape { dim: 4 dim: 3 dim: 2 dim: 2 } } }
layer { name: "mean" type: "Pooling" bottom: "data" top: "mean" pooling_param { pool: AVE global_pooling: true } }
"""


class Predicting(FolderTest):
    def setUp(self):
        super().setUp()
        (self.folder / 'net.prototxt').write_text(AVERAGE)
        self.files = (str(self.folder / 'net.prototxt'), None)

    def test_classifier(self):
        net = caffe.Classifier(*self.files, image_dims=(4, 4), raw_scale=10, channel_swap=(2, 1, 0))
        images = [picture(4, 4, 3) for _ in range(3)] + [picture(8, 6, 3)]
        middle = net.predict(images, oversample=False)
        self.assertEqual(middle.shape[:2], (4, 3))
        expected = images[0][1:3, 1:3].mean((0, 1))[::-1] * 10
        np.testing.assert_allclose(middle[0].ravel(), expected, rtol=1e-5)
        crops = io.oversample(images[:1], (2, 2))
        np.testing.assert_allclose(
            net.predict(images[:1])[0], crops.mean((0, 1, 2))[::-1] * 10, rtol=1e-5
        )

    @unittest.skipIf(Image is None, 'pillow is not installed')
    def test_detector(self):
        pixels = np.zeros((8, 8, 3), np.uint8)
        pixels[2:6, 4:8] = [255, 51, 0]
        Image.fromarray(pixels).save(self.folder / 'image.png')
        windows = [(str(self.folder / 'image.png'), np.array([[2, 4, 6, 8], [0, 0, 2, 8]]))]
        found = caffe.Detector(*self.files).detect_windows(windows)
        np.testing.assert_allclose(
            [f['prediction'].ravel() for f in found], [[1, 0.2, 0], [0, 0, 0]], atol=1e-6
        )
        self.assertEqual(found[0]['filename'], windows[0][0])
        self.assertEqual(caffe.Detector(*self.files).detect_windows([]), [])


class Specifying(unittest.TestCase):
    def test_a_net(self):
        L, P = caffe.layers, caffe.params
        n = caffe.NetSpec()
        n.data = L.Input(shape=dict(dim=[1, 3, 9, 9]))
        n.conv = L.Convolution(
            n.data,
            kernel_size=3,
            num_output=4,
            weight_filler=dict(type='xavier'),
            param=[dict(lr_mult=1), dict(lr_mult=2)],
        )
        n.relu = L.ReLU(n.conv, in_place=True)
        n.pool = L.Pooling(n.relu, kernel_size=2, stride=2, pool=P.Pooling.AVE)
        n.a, n.b = L.Slice(n.pool, ntop=2, slice_point=1)
        proto = n.to_proto()
        self.assertEqual(
            [layer.name for layer in proto.layer], ['data', 'conv', 'relu', 'pool', 'a']
        )
        conv, relu, pool, cut = proto.layer[1:]
        self.assertEqual(
            (list(relu.bottom), list(relu.top), list(pool.bottom)), (['conv'], ['conv'], ['conv'])
        )
        self.assertEqual(list(conv.convolution_param.kernel_size), [3])
        self.assertEqual(conv.convolution_param.weight_filler.type, 'xavier')
        self.assertEqual([param.lr_mult for param in conv.param], [1, 2])
        self.assertEqual(pool.pooling_param.pool, caffe_pb2.PoolingParameter.AVE)
        self.assertEqual(list(cut.top), ['a', 'b'])
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / 'net.prototxt'
            file.write_text(str(proto))
            net = caffe.Net(str(file), caffe.TEST)
        self.assertEqual(net.blobs['b'].shape, [1, 3, 4, 4])

    def test_names_are_made_up(self):
        L = caffe.layers
        data = L.Input(shape=dict(dim=[1, 2]))
        proto = caffe.to_proto(L.Eltwise(L.ReLU(data), L.ReLU(data)))
        self.assertEqual(
            [layer.name for layer in proto.layer], ['Input1', 'ReLU1', 'ReLU2', 'Eltwise1']
        )
        self.assertEqual(list(proto.layer[3].bottom), ['ReLU1', 'ReLU2'])

    def test_mistakes(self):
        L = caffe.layers
        with self.assertRaisesRegex(TypeError, 'ReLU input 0'):
            L.ReLU('data')
        with self.assertRaisesRegex(AttributeError, 'kernel'):
            L.Convolution(L.Input(), kernel=3).to_proto()
        with self.assertRaises(AttributeError):
            caffe.NetSpec().conv


class Module(unittest.TestCase):
    def test_functions_of_scripts(self):
        self.assertIn('Convolution', caffe.layer_type_list())
        self.assertIn('Input', caffe.layer_type_list())
        self.assertFalse(caffe.has_nccl())
        timer = caffe.Timer()
        timer.start()
        timer.stop()
        self.assertGreaterEqual(timer.ms, 0)


if __name__ == '__main__':
    unittest.main()
