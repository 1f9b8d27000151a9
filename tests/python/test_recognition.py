"""revisit.recognition and revisit.datasets: points, images, features, files."""

import ctypes
import gc
import tempfile
import unittest
from types import SimpleNamespace
from pathlib import Path

import numpy as np

import revisit
from nets import CONVOLVE, folder_with
from revisit import datasets, recognition
from revisit.engine import Precision
from scans import room


def structured(points, kind='f4'):
    """Returns an array like that of a driver: more fields around x, y, z, no padding."""
    scan = np.zeros(len(points), [('stamp', 'u2'), ('x', kind), ('y', kind), ('z', kind), ('ring', 'u1')])
    for i, axis in enumerate('xyz'):
        scan[axis] = points[:, i]
    return scan


class OnGpu:
    """Returns an array like torch.zeros(shape, device='cuda'), with a device address."""

    def __init__(self, *shape):
        self.dtype, self.shape, self.device = 'torch.float32', shape, 'cuda:0'
        self.host = np.zeros(shape, np.float32)

    def __dlpack__(self, **_):
        capsule = self.host.__dlpack__()
        get = ctypes.pythonapi.PyCapsule_GetPointer
        get.restype, get.argtypes = ctypes.c_void_p, [ctypes.py_object, ctypes.c_char_p]
        tensor = get(capsule, b'dltensor')  # DLManagedTensor: address and device type, 2 for CUDA
        ctypes.c_uint64.from_address(tensor).value = 0x7f0000000040
        ctypes.c_int32.from_address(tensor + 8).value = 2
        return capsule

    def __dlpack_device__(self):
        return 2, 0


class Points(unittest.TestCase):
    def setUp(self):
        self.points = room(1)
        self.image = recognition.project(self.points)

    def test_any_layout_is_the_same_scan(self):
        p = self.points
        layouts = {
            'three columns': p[:, :3], 'contiguous': np.ascontiguousarray(p[:, :3]),
            'columns': np.asfortranarray(p), 'twice as wide': np.repeat(p, 2, 1)[:, ::2],
            'structured': structured(p), 'every other': np.repeat(structured(p), 2)[::2],
            'tuple': tuple(p[:, :3].T), 'tuple of fields': tuple(structured(p)[axis] for axis in 'xyz'),
            'list': [p[:, 0].copy(), p[:, 1], p[:, 2]],
            'backwards': p[::-1], 'doubles': p.astype(np.float64), 'doubles backwards': p.astype(np.float64)[::-1],
            'columns of doubles': np.asfortranarray(p[:, :3].astype(np.float64)),
            'a point per column': np.ascontiguousarray(p[:, :3].T.astype(np.float64)).T,
            'structured doubles': structured(p, 'f8'), 'tuple of doubles': tuple(p[:, :3].T.astype(np.float64)),
            'tuple of fields of doubles': tuple(structured(p, 'f8')[axis] for axis in 'xyz'),
            'structured, with more doubles': structured(p, 'f8')[['y', 'x', 'z', 'stamp']]}
        read_only = p.copy()
        read_only.flags.writeable = False
        layouts['read-only'] = read_only
        for name, layout in layouts.items():
            np.testing.assert_array_equal(recognition.project(layout), self.image, name)

    def test_others_are_refused(self):
        p = self.points
        mixed = np.zeros(5, [('x', 'f4'), ('y', 'f8'), ('z', 'f4')])
        for wrong in (mixed, (p * 1000).astype(np.int32), p.astype('>f4'), p.astype('>f8'), p.tolist()[:5], 'scan', None, 7,
                      structured(p)[['x', 'y']], (p[:, 0], p[:, 1]), p.astype(np.float16)):
            with self.assertRaises(TypeError, msg=repr(wrong)[:60]):
                recognition.project(wrong)
        for wrong in (p[:, :2], p.ravel(), p[None], structured(p)[None], (p[:, 0], p[:, 1], p[1:, 2]), (p, p, p)):
            with self.assertRaises(ValueError, msg=repr(wrong)[:60]):
                recognition.project(wrong)
        for wrong in (p.T, p[:, :3].T, p[:, :3].T.astype(np.float64).copy()):
            with self.assertRaisesRegex(ValueError, r'found float.* array of shape .*, which has a column for each point; use x\.T'):
                recognition.project(wrong)
        only_interface = SimpleNamespace(__array_interface__=p.__array_interface__)
        for wrong in (only_interface, np.ndarray):
            with self.assertRaisesRegex(TypeError, 'points: expected a numpy array'):
                recognition.project(wrong)
        masked = np.ma.masked_array(p, p > 10)  # masked points must not be projected
        for wrong in (masked, tuple(masked[:, :3].T)):
            with self.assertRaisesRegex(TypeError, r'masked array, .*filled\(value\)'):
                recognition.project(wrong)
        with self.assertRaisesRegex(TypeError, r'found float16 array of shape \(57600, 4\)'):
            recognition.project(p.astype(np.float16))

    def test_arrays_of_a_gpu_are_refused(self):
        column = OnGpu(5)
        for call in (lambda: recognition.project((column, column, column)), lambda: recognition.cosine(column, column)):
            with self.assertRaisesRegex(TypeError, 'found torch.float32 array of shape .* on cuda:0'):
                call()

    def test_none_are_an_empty_image(self):
        self.assertFalse(recognition.project(np.zeros((0, 3), np.float32)).any())
        self.assertFalse(recognition.project(np.full((5, 3), np.nan, np.float32)).any())


    def test_altered_as_the_program_does(self):
        lower = datasets.perturb(self.points, 1, 'height=1')
        np.testing.assert_allclose(lower, self.points + np.float32([0, 0, 1, 0]), atol=1e-5)
        at_random = [datasets.perturb(self.points, seed) for seed in (1, 2, 3, 4, 2)]
        np.testing.assert_array_equal(at_random[1], at_random[4])
        self.assertGreater(len({points.tobytes() for points in at_random}), 2)
        with self.assertRaises(revisit.UsageError):
            datasets.perturb(self.points, 1, 'no-such-step')


class Images(unittest.TestCase):
    def test_pixels_are_ranges(self):
        wall = np.array([[-40, 0, 0], [0, 20, 0]], np.float32)
        geometry = recognition.ImageGeometry(width=8, height=4, elevation_top=10, elevation_bottom=-10)
        image = recognition.project(wall, geometry)
        self.assertEqual(image.shape, (4, 8))
        self.assertEqual(image[2, 2], np.float32(255 * 20 / 80))
        self.assertEqual(image[2, 0] + image[2, 7], np.float32(255 * 40 / 80))
        with self.assertRaisesRegex(revisit.UsageError, 'elevation'):
            recognition.ImageGeometry(elevation_top=-30)

    def test_sensors_are_known(self):
        names = [sensor.name for sensor in recognition.sensors()]
        self.assertIn('hdl64', names)
        self.assertEqual(recognition.sensor_geometry('vlp16').width, 4000)
        with self.assertRaisesRegex(revisit.UsageError, 'hdl64'):
            recognition.sensor_geometry('hdl65')

    def test_alignment_turns_with_the_scan(self):
        box = np.random.default_rng(1).uniform([-30, -5, -1], [30, 5, 3], (5000, 3)).astype(np.float32)
        found = recognition.principal_alignment(box)
        self.assertLess(abs(found.R_aligned_sensor[0, 1]), 0.05)
        np.testing.assert_allclose(found.R_aligned_sensor @ found.R_aligned_sensor.T, np.eye(3), atol=1e-5)
        self.assertGreater(found.eigenvalue_ratio, 10)
        with self.assertRaises(revisit.InputError):
            recognition.principal_alignment(box[:2])


class Features(unittest.TestCase):
    def test_network_sees_the_image(self):
        geometry = recognition.ImageGeometry(width=64, height=16)
        with folder_with(net=CONVOLVE) as folder:
            net = revisit.engine.Net.load_with_random_weights(
                folder / 'net.prototxt', 3, end='pool', inputs={'data': (1, 3, 16, 64)})
        extractor = recognition.network_features(net, 'seed 3', mean_bgr=(1, 2, 3), geometry=geometry)
        self.assertEqual(extractor.dim, 4 * 8 * 32)
        points = room(2)
        feature = recognition.from_scan(extractor, 'none', geometry)(points)
        run = net.plan().run()
        image = recognition.scan_to_image(points, 'none', geometry)
        run.forward({'data': np.stack([image - 1, image - 2, image - 3])[None]})
        np.testing.assert_allclose(feature, run.output('pool').ravel(), rtol=1e-4, atol=1e-2)

    def test_scan_context_knows_turns(self):
        describe = recognition.from_scan(recognition.scan_context_features())
        a, b, other = (describe(points).reshape(20, 60) for points in (room(3), room(3, np.radians(60)), room(4)))
        shift = min(range(60), key=lambda k: np.abs(a - np.roll(b, k, 1)).sum())
        self.assertIn(shift, (10, 50))
        self.assertLess(np.abs(a - np.roll(b, shift, 1)).sum(), min(np.abs(a - np.roll(other, k, 1)).sum() for k in range(60)))
        with self.assertRaises(revisit.UsageError):
            recognition.ScanContextOptions(rings=0)

    def test_cosine(self):
        a = np.array([1, 0, 1], np.float32)
        self.assertAlmostEqual(recognition.cosine(a, np.array([1, 1, 0], np.float32)), 0.5)
        with self.assertRaises(TypeError):
            recognition.cosine(a, [1, 1, 0])
        with self.assertRaises(ValueError):
            recognition.cosine(a, a[:2])

    def test_rings_come_with_the_library(self):
        self.assertIn('hdl64', recognition.shipped_ring_models())
        model = recognition.shipped_ring_model('hdl64')
        self.assertEqual(recognition.ring_recognizer(model).dim, model.dim)
        bf16 = recognition.ring_recognizer(model, recognition.ring_net(model), precision=Precision.BF16)
        self.assertNotEqual(bf16.key, recognition.ring_recognizer(model).key)
        with self.assertRaises(revisit.InputError):
            recognition.read_ring_model('nowhere.ring')


class Files(unittest.TestCase):
    def test_scans_go_out_and_in(self):
        points = room(5)
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / '000000.bin'
            datasets.write_kitti_scan(file, points)
            np.testing.assert_array_equal(np.fromfile(file, np.float32).reshape(-1, 4), points)
            read = datasets.read_scan(file)
            scans = datasets.open_dataset(folder).scans
            file.write_bytes(b'12345')
            with self.assertRaisesRegex(revisit.InputError, '000000.bin'):
                datasets.read_scan(file)
        gc.collect()
        np.testing.assert_array_equal(read, points)
        self.assertTrue(read.flags.writeable)
        self.assertEqual([scan.file for scan in scans], [file])
        self.assertIsNone(scans[0].pose)

    def test_intensity_is_the_fourth_column_of_any_strides(self):
        points = room(5)[:50]
        points[:, 3] = np.arange(50)
        packed = np.ndarray((50, 4), '<f4', np.zeros(18 * 50, np.uint8), 0, (18, 4))  # as in a PointCloud2 with rings
        packed[:] = points
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / '000000.bin'
            for layout in (packed, packed[::-1], points, points.astype(np.float64), np.asfortranarray(points), np.repeat(points, 2, 1)[:, ::2]):
                datasets.write_kitti_scan(file, layout)
                np.testing.assert_array_equal(datasets.read_scan(file), layout)
            datasets.write_kitti_scan(file, points[:, :3])
            self.assertFalse(datasets.read_scan(file)[:, 3].any())


if __name__ == '__main__':
    unittest.main()
