"""Whatever a script did to a net, it computes what a new net with the same weights does."""

import random
import tempfile
import unittest
from pathlib import Path

import caffe_needs  # noqa: F401
import numpy as np

import revisit.caffe as caffe

FORMATS = Path(__file__).parents[1] / 'golden/formats'
PROTOTXT = str(FORMATS / 'mini_v2.prototxt')


class Script:
    """One that does what it likes."""

    def __init__(self, seed):
        self.random = random.Random(seed)
        self.numbers = np.random.default_rng(seed)
        self.net = caffe.Net(PROTOTXT, caffe.TEST, weights=str(FORMATS / 'mini_v2.caffemodel'))
        self.shape = self.net.blobs['data'].shape
        self.held = []

    def some_weights(self):
        return self.random.choice(self.random.choice(list(self.net.params.values())))

    def write(self):
        self.some_weights().data[...] *= 1 + self.numbers.random()

    def hold(self):
        self.held.append(self.some_weights().data)
        self.held.append(self.random.choice(list(self.net.blobs.values())).data)

    def write_to_held(self):
        for array in self.held:
            array.flat[self.numbers.integers(array.size)] += 0.5

    def let_go(self):
        self.held.clear()

    def run(self):
        self.net.forward()

    def run_a_part(self):
        layers = self.net._layer_names
        first, last = sorted(self.random.choices(range(len(layers)), k=2))
        self.net.forward(start=layers[first], end=layers[last])

    def reshape(self):
        self.net.blobs['data'].reshape(self.random.randint(1, 3), *self.shape[1:])
        self.net.reshape()


class Anything(unittest.TestCase):
    def check(self, script, file):
        net = script.net
        net.save(file)
        new = caffe.Net(PROTOTXT, caffe.TEST, weights=file)
        image = script.numbers.standard_normal(net.blobs['data'].shape)
        new.blobs['data'].reshape(*image.shape)
        new.forward(data=image)
        net.forward(data=image)
        for name, blob in net.blobs.items():
            np.testing.assert_array_equal(blob.data, new.blobs[name].data, name)
        # What runs as one in the whole net may be cut here, and rounds otherwise.
        net.forward(start=script.random.choice(net._layer_names[1:]))
        for name, blob in net.blobs.items():
            np.testing.assert_allclose(blob.data, new.blobs[name].data, 1e-4, 1e-5, err_msg=name)

    def test_does_no_harm(self):
        with tempfile.TemporaryDirectory() as folder:
            for seed in range(3):
                script = Script(seed)
                writing = [script.write, script.hold, script.write_to_held, script.let_go]
                actions = [*writing, script.run, script.run_a_part, script.reshape]
                for _ in range(10):
                    for action in script.random.choices(actions, k=4):
                        action()
                    with self.subTest(seed=seed):
                        self.check(script, f'{folder}/weights.caffemodel')


if __name__ == '__main__':
    unittest.main()
