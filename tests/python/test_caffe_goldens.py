"""revisit.caffe against outputs of the original Caffe: tests/golden, and ../shared or REVISIT_TEST_DATA."""

import json
import os
import unittest
import warnings
from pathlib import Path

import numpy as np

import caffe_needs  # noqa: F401

import revisit
import revisit.caffe as caffe

ROOT = Path(__file__).parents[2]
SHARED = Path(os.environ.get('REVISIT_TEST_DATA', ROOT.parent / 'shared'))


def error(found, expected):
    """Returns the maximum error relative to the maximum value; infinite if non-finite values differ."""
    finite = np.isfinite(expected)
    if not np.array_equal(found[~finite], expected[~finite], equal_nan=True):
        return np.inf
    found, expected = found[finite], expected[finite]
    return np.abs(found - expected).max(initial=0) / max(np.abs(expected).max(initial=0), 1e-30)


class Goldens(unittest.TestCase):
    def check_outputs(self, folder, most=1e-5):
        weights = next(iter(folder.glob('weights.*')), None)
        prototxt = next(folder.glob('*.prototxt'))
        with warnings.catch_warnings():
            warnings.simplefilter('ignore')
            net = caffe.Net(str(prototxt), caffe.TEST, weights=weights and str(weights))
        for file in folder.glob('in*.npy'):
            values = np.load(file)
            name = file.stem.removeprefix('in').removeprefix('_') or net.inputs[0]
            net.blobs[name].reshape(*values.shape)
            net.blobs[name].data[...] = values
        outputs = net.forward()
        files = list(folder.glob('out_*.npy'))
        self.assertTrue(files)
        for file in files:
            expected = np.load(file)
            name = next(name for name in outputs if name.replace('/', '@') == file.stem[4:])
            self.assertEqual(outputs[name].shape, expected.shape)
            self.assertLess(error(outputs[name], expected), most, f'{folder.name}: {name}')

    def test_nets_of_the_repository(self):
        folders = [
            file.parent for file in sorted((ROOT / 'tests/golden/zoo').glob('*/net.prototxt'))
        ]
        self.assertGreater(len(folders), 20)
        for folder in folders:
            with self.subTest(folder.name):
                self.check_outputs(folder)

    def test_every_form_of_files(self):
        folder = ROOT / 'tests/golden/formats'
        pairs = json.loads((folder / 'index.json').read_text())
        self.assertGreater(len(pairs), 20)
        for pair in pairs:
            if not pair['caffe_accepts']:
                continue
            with self.subTest(pair['prototxt'] + ' ' + pair['weights']):
                net = caffe.Net(
                    str(folder / pair['prototxt']), str(folder / pair['weights']), caffe.TEST
                )
                out = net.forward(data=np.load(folder / 'in_data.npy'))
                for name, values in out.items():
                    self.assertLess(error(values, np.load(folder / f'out_{name}.npy')), 1e-5)

    def test_trained_models(self):
        folders = [
            file.parent for file in sorted((SHARED / 'data/caffemodels').glob('*/deploy.prototxt'))
        ]
        if not folders:
            self.skipTest(
                f'no {SHARED / "data/caffemodels"}; REVISIT_TEST_DATA names the folder of test data'
            )
        for folder in folders:
            with self.subTest(folder.name):
                self.check_outputs(
                    folder, 1e-4
                )  # a Softmax of large scores; MTCNN's differs by 6e-5 even with sequential sums


class Verdicts(unittest.TestCase):
    """Unusual prototxts: Caffe's outputs, or its rejection."""

    STRICTER = {'net_inplace_conv', 'net_inplace_pool', 'net_inplace_lrn'}  # docs/reference/LAYERS.md
    OTHER = {'engine_cudnn'}  # rejected by a Caffe without CUDA

    def test_every_one(self):
        folder = ROOT / 'tests/golden/parse'
        for name, verdict in json.loads((folder / 'index.json').read_text()).items():
            file = str(folder / f'{name}.prototxt')
            with self.subTest(name), warnings.catch_warnings():
                warnings.simplefilter('ignore')
                if name in self.OTHER:
                    caffe.Net(file, caffe.TEST)
                elif name in self.STRICTER or not verdict['accept']:
                    with self.assertRaises(revisit.Error):
                        caffe.Net(file, caffe.TEST)
                else:
                    net = caffe.Net(file, caffe.TEST)
                    shapes = {name: blob.shape for name, blob in net.blobs.items()}
                    self.assertEqual(shapes, verdict['blobs'])
                    self.assertEqual(net._layer_names, verdict['layers'])
                    self.assertEqual(net.outputs, verdict['outputs'])


class Structure(unittest.TestCase):
    """Public nets at an eighth of their width: names of all layers, and the final content of every blob."""

    def check(self, folder):
        manifest = json.loads((folder / 'manifest.json').read_text())
        net = caffe.Net(
            str(folder / 'deploy.prototxt'), str(folder / 'weights.caffemodel'), caffe.TEST
        )
        image = np.load(folder / manifest['input'])
        net.blobs[net.inputs[0]].reshape(*image.shape)
        net.forward(**{net.inputs[0]: image})
        entries = manifest['layers']
        self.assertEqual(list(dict.fromkeys(entry['layer'] for entry in entries)), net._layer_names)
        last = {}
        for entry in entries:
            self.assertIn(entry['top'], net.top_names[entry['layer']])
            self.assertEqual(list(entry['bottoms']), net.bottom_names[entry['layer']])
            last[entry['top']] = entry
        self.assertEqual(list(last), list(net.blobs))
        for name, entry in last.items():
            values = net.blobs[name].data
            self.assertEqual(list(values.shape), entry['shape'], name)
            scale = entry['absmax']
            self.assertLess(abs(np.abs(values).max() - scale), 1e-4 * scale, name)
            self.assertLess(abs(values.mean(dtype=float) - entry['mean']), 1e-4 * scale, name)
            flat = values.ravel()
            for found, expected in ((flat[:4], entry['first']), (flat[-4:], entry['last'])):
                np.testing.assert_allclose(
                    found, expected[: len(found)], rtol=0, atol=1e-4 * scale, err_msg=name
                )

    def test_public_nets(self):
        folders = [file.parent for file in sorted((SHARED / 'golden/slim').glob('*/manifest.json'))]
        if not folders:
            self.skipTest(
                f'no {SHARED / "golden/slim"}; REVISIT_TEST_DATA names the folder of test data'
            )
        for folder in folders:
            with self.subTest(folder.name):
                self.check(folder)


class Parts(unittest.TestCase):
    def setUp(self):
        folder = SHARED / 'golden/nets/alexnet'
        if not folder.is_dir():
            self.skipTest(f'no {folder}; REVISIT_TEST_DATA names the folder of test data')
        self.wrote = {
            file.name[4:].removesuffix('.0.npy'): np.load(file)
            for file in sorted((folder / 'all_64x160').iterdir())
        }
        self.net = caffe.Net(
            str(folder / 'pool5.prototxt'), str(folder / 'weights.caffemodel'), caffe.TEST
        )
        self.net.blobs['data'].reshape(*self.wrote['data'].shape)
        self.net.reshape()

    def test_up_to_every_layer(self):
        self.net.blobs['data'].data[...] = self.wrote['data']
        self.assertGreater(len(self.wrote), 10)
        for layer, expected in self.wrote.items():
            found = self.net.forward(end=layer)[self.net.top_names[layer][0]]
            self.assertLess(error(found, expected), 1e-5, layer)

    def test_from_every_layer(self):
        layers = list(self.wrote)
        for before, layer in zip(layers, layers[1:]):
            self.net.blobs[self.net.bottom_names[layer][0]].data[...] = self.wrote[before]
            found = self.net.forward(start=layer)['pool5']
            self.assertLess(error(found, self.wrote['pool5']), 1e-5, layer)


if __name__ == '__main__':
    unittest.main()
