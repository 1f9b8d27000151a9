"""After random operations of a script, a net computes the same as a new net with the same weights."""

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
        # Layers that are fused in the full net may be split here, and round differently.
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


def softmax(x, axis):
    e = np.exp(x - x.max(axis, keepdims=True))
    return e / e.sum(axis, keepdims=True)


# Type and parameters of layers -> function of an array.
IN_PLACE = {
    ('ReLU', ''): lambda x: np.maximum(x, 0),
    ('Power', 'power_param { scale: -2 shift: 1 }'): lambda x: -2 * x + 1,
    ('Softmax', 'softmax_param { axis: 0 }'): lambda x: softmax(x, 0),
    ('Scale', 'scale_param { axis: 0 filler { value: 3 } }'): lambda x: 3 * x,
}
SHARING = {
    ('Split', ''): lambda x: x,
    ('Flatten', 'flatten_param { axis: 0 }'): lambda x: x.reshape(-1),
    ('Reshape', 'reshape_param { shape { dim: 4 dim: 6 } }'): lambda x: x.reshape(4, 6),
    ('Concat', 'concat_param { axis: 0 }'): lambda x: x,
    ('Slice', 'slice_param { axis: 0 }'): lambda x: x,
    ('Permute', 'permute_param { order: 0 }'): lambda x: x,
}
COPY = ('Power', 'power_param { shift: 0.5 }')


class CaffesMemory:
    """A random net, and its blobs as numpy views."""

    def __init__(self, seed):
        chosen = random.Random(seed)
        self.blobs = {'b': np.zeros((2, 3, 4), np.float32)}
        self.layers = []  # (function, bottom, top)
        self.text = 'layer { name: "b" type: "Input" top: "b" input_param { shape { dim: [2, 3, 4] } } }'
        read = set()
        for i in range(chosen.randint(3, 10)):
            bottom, top = chosen.choice(list(self.blobs)), f't{i}'
            if bottom not in read and chosen.random() < 0.5:  # Caffe rejects other nets with in-place layers
                (type_, params), act = chosen.choice(list(IN_PLACE.items()))
                top = bottom
            elif chosen.random() < 0.7:
                (type_, params), view = chosen.choice(list(SHARING.items()))
                self.blobs[top], act = view(self.blobs[bottom]), None
            else:
                (type_, params), act = COPY, lambda x: x + np.float32(0.5)
                self.blobs[top] = np.zeros_like(self.blobs[bottom])
            if top != bottom:
                read.add(bottom)
            self.layers.append((act, bottom, top))
            self.text += f'layer {{ name: "{i}" type: "{type_}" bottom: "{bottom}" top: "{top}" {params} }}\n'

    def forward(self, first, last):
        for act, bottom, top in self.layers[first : last + 1]:
            if act:
                self.blobs[top][...] = act(self.blobs[bottom])


class SharedMemory(unittest.TestCase):
    def test_blobs_equal_caffes(self):
        for seed in range(60):
            memory, chosen = CaffesMemory(seed), random.Random(seed)
            with self.subTest(net=memory.text), tempfile.NamedTemporaryFile('w', suffix='.prototxt') as file:
                file.write(memory.text)
                file.flush()
                net, held, n = caffe.Net(file.name, caffe.TEST), [], len(memory.layers)
                for first, last in [(0, n - 1), *(sorted(chosen.choices(range(n), k=2)) for _ in range(3)), (0, n - 1)]:
                    written = chosen.choice(list(memory.blobs))
                    values = np.random.default_rng(seed).normal(size=memory.blobs[written].shape)
                    if first == 0:
                        written, values = 'b', values.reshape(2, 3, 4)
                    memory.blobs[written][...] = net.blobs[written].data[...] = values
                    held.append((name := chosen.choice(list(memory.blobs)), net.blobs[name].data))
                    memory.forward(first, last)
                    net.forward(start=str(first) if first else None, end=str(last))
                    for name, data in [*held, *((name, blob.data) for name, blob in net.blobs.items())]:
                        if name in memory.blobs:  # except Caffe's Split layers
                            np.testing.assert_allclose(data, memory.blobs[name], 1e-4, 1e-5, err_msg=name)


if __name__ == '__main__':
    unittest.main()
