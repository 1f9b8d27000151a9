"""Ranges of consecutive layers, each as a separate net of the engine.

The engine only runs full nets. A forward pass over some layers therefore runs a net of these layers, whose inputs are the
blobs that they read.
"""

from collections import Counter, OrderedDict

from . import _engine, _fillers
from ._structure import IN_PYTHON, computing, views
from .proto import caffe_pb2

_BOUNDARY = 'what earlier layers wrote'  # name of the Input layer
_MAX_PASSES = 4  # cached passes with different input shapes; each has the memory of all blobs


def _read(messages):
    """Returns the blobs that layers read and none of them wrote before, in order."""
    read, written = {}, set()
    for message in messages:
        read.update((blob, None) for blob in message.bottom if blob not in written)
        written.update(message.top)
    return list(read)


class Pass:
    """A range with fixed input shapes."""

    def __init__(self, plan, written):
        self._plan = plan
        self._run = None  # allocated by the first forward()
        self._written = written

    def shapes(self):
        """Returns name -> shape of the blobs that are written."""
        shapes = {_engine.port_name(layer.name, i): shape
                  for layer in self._plan.layers for i, shape in enumerate(layer.outputs)}
        return {blob: shapes[port] for blob, port in self._written.items()}

    def forward(self, values):
        """Runs a pass. values: input name -> array. Returns blob -> view of the written values."""
        if self._run is None:
            self._run = self._plan.run()
        for blob, array in values.items():
            self._run.set_input(blob, array)
        self._run.forward()
        return {blob: self._run.layer_output(port) for blob, port in self._written.items()}


class Range:
    """Layers, from _structure.with_splits(), that run together.

    shape_of: function from the name of a blob to its current shape.
    prototxt: file name for messages.
    """

    def __init__(self, layers, shape_of, prototxt):
        self.net = caffe_pb2.NetParameter(name='net')
        self.written = {}  # blob -> port of its final value in the engine, in the order of writing
        messages = [layer.message for layer in layers if layer.message is not None and layer.type not in IN_PYTHON]
        self.inputs = _read(messages)  # names of blobs
        if self.inputs:
            self._add_input(_BOUNDARY, self.inputs, shape_of)
        names = set()
        for message in messages:
            self._add(message, shape_of, names)
        self._prototxt = prototxt
        self._engine = None
        self._passes = OrderedDict()
        self.weight_bytes = 0

    def _add_input(self, name, blobs, shape_of):
        layer = self.net.layer.add(name=name, type='Input')
        layer.top.extend(blobs)
        for blob in blobs:
            layer.input_param.shape.add().dim.extend(shape_of(blob))

    def _add(self, message, shape_of, names):
        if message.type == 'Input':
            self._add_input(message.name, message.top, shape_of)
            self.inputs.extend(message.top)
            return
        layer = self.net.layer.add()
        layer.CopyFrom(message)
        for field in ('include', 'exclude', 'blobs'):
            layer.ClearField(field)
        while layer.name in names:  # legal in Caffe, but the engine identifies values by layer names
            layer.name += ' (again)'
        names.add(layer.name)
        for i, blob in enumerate(layer.top):
            self.written.pop(blob, None)
            self.written[blob] = _engine.port_name(layer.name, i)

    @property
    def names(self):
        """Engine's names of the computing layers, in order."""
        return [layer.name for layer in self.net.layer if layer.type != 'Input']

    def load(self, weights):
        """Loads the engine's net; see _engine.load(). Returns layer name -> arrays of the engine."""
        if not self.net.layer:  # all layers run in Python
            return {}
        self._engine = _engine.load(self.net, weights, self._prototxt)
        self._passes.clear()
        arrays = self._engine.weights
        self.weight_bytes = sum(array.nbytes for some in arrays.values() for array in some)
        return arrays

    def plan(self, shapes):
        """Returns the pass for these input shapes, by blob."""
        threads = _engine.threads()
        key = (threads, *(tuple(shapes[blob]) for blob in self.inputs))
        if key not in self._passes:
            while len(self._passes) >= _MAX_PASSES:
                self._passes.popitem(last=False)
            inputs = {blob: list(shapes[blob]) for blob in self.inputs}
            with _engine.named(self._prototxt):
                plan = self._engine.plan(
                    inputs, threads=threads, keep=list(self.written.values()), seed=_fillers.pass_seed()
                )
            self._passes[key] = Pass(plan, self.written)
        self._passes.move_to_end(key)
        return self._passes[key]


class Ranges:
    """The full net, and a cache of recently run ranges.

    Each range has its own copy of weights. The cache drops the oldest ranges when their weights exceed twice those of the net.
    """

    def __init__(self, layers, shape_of, prototxt):
        self.full = Range(layers, shape_of, prototxt)
        self._layers = layers
        self._views = views(layers)
        self._context = shape_of, prototxt
        self._kept = OrderedDict()  # oldest first

    def clear(self):
        self._kept.clear()

    def get(self, first, last):
        """Returns the range of the layers first to last, inclusive; None if none of them computes."""
        start, end = (len(computing(self._layers[:index])) for index in (first, last + 1))
        layers = computing(self._layers)
        if start >= end:
            return None
        if end - start == len(layers):
            return self.full
        if (start, end) not in self._kept:
            layers = self._with_views(layers[start:end])
            range_ = Range(layers, *self._context)
            named = zip(range_.names, layers)
            range_.load({name: [blob.read() for blob in layer.blobs] for name, layer in named if layer.blobs})
            self._kept[start, end] = range_
            self._forget()
        self._kept.move_to_end((start, end))
        return self._kept[start, end]

    def _with_views(self, layers):
        """Prepends the view layers that create the inputs, where several inputs share memory in Caffe.

        Inputs of the engine cannot share memory. Running view layers again is harmless, because they move no data.
        """
        read = _read(layer.message for layer in layers)
        n_read = Counter(map(self._memory, read))
        needed = {blob for blob in read if n_read[self._memory(blob)] > 1}
        before = []
        for layer in reversed(dict.fromkeys(self._views.values())):
            if needed.intersection(layer.tops):
                needed.add(layer.message.bottom[0])
                before.insert(0, layer)
        return before + layers

    def _memory(self, blob):
        """Returns the first blob with the memory of `blob`."""
        while blob in self._views:
            blob = self._views[blob].message.bottom[0]
        return blob

    def _forget(self):
        bytes_of = lambda: sum(kept.weight_bytes for kept in self._kept.values())
        while len(self._kept) > 1 and bytes_of() > 2 * self.full.weight_bytes:
            self._kept.popitem(last=False)
