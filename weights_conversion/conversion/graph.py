"""Networks as graphs of layers and values in single-assignment form: in-place layers write new values."""

from dataclasses import dataclass, field
from difflib import get_close_matches

from revisit.caffe._structure import shares_memory

from .errors import InputError, UnsupportedError, UsageError


@dataclass
class Layer:
    """A layer; `inputs` and `outputs` are indices of values."""

    name: str
    type: str
    message: object  # LayerParameter
    inputs: list = field(default_factory=list)
    outputs: list = field(default_factory=list)

    def ports(self):
        """Returns the engine's names of its outputs: 'layer', 'layer.1', ..."""
        return [self.name if i == 0 else f'{self.name}.{i}' for i in range(len(self.outputs))]


@dataclass
class Graph:
    """layers: in the order of the file. blobs: name of each value. outputs: pairs (name, value)."""

    layers: list = field(default_factory=list)
    blobs: list = field(default_factory=list)
    outputs: list = field(default_factory=list)

    def find(self, name, what):
        for layer in self.layers:
            if layer.name == name:
                return layer
        near = get_close_matches(name, [layer.name for layer in self.layers], 1)
        raise UsageError(f"{what}: the net has no layer '{name}'" + (f" (did you mean '{near[0]}'?)" if near else ''))

    def require_unique_names(self):
        """Rejects duplicate names (legal in Caffe), because names identify weights and outputs."""
        names = set()
        for layer in self.layers:
            if layer.name in names:
                raise UnsupportedError(f"duplicate layer name '{layer.name}'; give each layer its own name")
            names.add(layer.name)

    def require_inputs(self):
        for layer in self.layers:
            if None in layer.inputs:
                blob = layer.message.bottom[layer.inputs.index(None)]
                raise InputError(f"layer '{layer.name}': no earlier layer writes its bottom '{blob}'")

    def readers(self, value):
        return [layer for layer in self.layers if value in layer.inputs]


def is_of_batch(message):
    """Whether a BatchNorm layer uses the statistics of the current batch."""
    p = message.batch_norm_param
    in_training = message.HasField('phase') and message.phase == 0  # TRAIN
    return not p.use_global_stats if p.HasField('use_global_stats') else in_training


class _Resolver:
    """Resolves names of blobs to values, layer by layer, like engine/src/graph.cpp."""

    def __init__(self):
        self.graph = Graph()
        self.current = {}  # blob -> value
        self.read = set()
        self.memory = []  # value -> first value in its memory
        self.content = []  # value -> value with the same content
        self.latest = {}  # memory that an in-place layer wrote -> (value, name of the layer)

    def add(self, message):
        layer = Layer(message.name, message.type, message)
        for blob in message.bottom:
            if blob in self.current:
                self.current[blob] = self._up_to_date(self.current[blob])
            layer.inputs.append(self.current.get(blob))
        self.read.update(layer.inputs)
        for i, blob in enumerate(message.top):
            value = self.current[blob] = self._new_value(blob)
            layer.outputs.append(value)
            if i < len(message.bottom) and message.bottom[i] == blob and layer.inputs[i] is not None:
                self.memory[value] = self.memory[layer.inputs[i]]
                self.latest[self.memory[value]] = value, layer.name
            elif shares_memory(message) and layer.inputs and layer.inputs[0] is not None:
                self.memory[value], self.content[value] = self.memory[layer.inputs[0]], self.content[layer.inputs[0]]
        self.graph.layers.append(layer)

    def finish(self):
        for value in list(self.current.values()):
            if value not in self.read:
                self._up_to_date(value)
        self.graph.outputs = [(blob, value) for value, blob in enumerate(self.graph.blobs) if value not in self.read]
        return self.graph

    def _new_value(self, blob):
        value = len(self.graph.blobs)
        self.graph.blobs.append(blob)
        self.memory.append(value)
        self.content.append(value)
        return value

    def _up_to_date(self, value):
        written, layer = self.latest.get(self.memory[value], (value, None))
        if self.content[value] == self.content[written]:
            return value
        blob = self.graph.blobs[value]
        result = self._new_value(blob)
        self.graph.layers.append(Layer(f'{blob} after {layer}', 'Split', None, [written, value], [result]))
        self.memory[result], self.content[result] = self.memory[value], written
        if value in self.read:
            self.read.add(result)
        self.read.add(value)
        return result


def resolve(net):
    """Returns the graph of a NetParameter in the current format. Inputs that no layer writes are None.

    In Caffe, an in-place layer changes all blobs that share its memory. An inserted Split with two inputs expresses this: it
    returns the first input in the shape of the second.
    """
    resolver = _Resolver()
    for message in net.layer:
        resolver.add(message)
    return resolver.finish()


def truncate(graph, end, graft):
    """Truncates the graph after the layer `end` and appends a copy of the layer `graft`, like the engine."""
    if graft and not end:
        raise UsageError('--graft: give --end, the layer to graft onto')
    if end:
        last = graph.find(end, '--end')
        graph.outputs = list(zip(last.ports(), last.outputs))
        if graft:
            source = graph.find(graft, '--graft')
            if len(source.inputs) != 1 or len(source.outputs) != 1 or len(last.outputs) != 1:
                raise UsageError(f"--graft: expected '{graft}' and '{end}' with one input and one output")
            copy = Layer(f'{end}+{graft}', source.type, source.message,
                         [_after_its_block(graph, last.outputs[0])], [len(graph.blobs)])
            graph.blobs.append(copy.name)
            graph.layers.append(copy)
            graph.outputs = [(copy.name, copy.outputs[0])]
    _keep_needed(graph, bool(end))
    graph.require_unique_names()
    return graph


def _after_its_block(graph, value):
    """Returns a value after in-place layers, and after the normalization and ReLU that are its only readers."""
    activated = False
    while True:
        readers = graph.readers(value)
        in_place = [(layer, after) for layer in readers for before, after in zip(layer.inputs, layer.outputs)
                    if before == value and layer.message and graph.blobs[before] == graph.blobs[after]]
        alone = [(layer, layer.outputs[0]) for layer in readers if len(readers) == len(layer.inputs) == 1 and not activated
                 and layer.type in ('ReLU', 'BatchNorm', 'Scale')]
        if not in_place and not alone:
            return value
        layer, value = (in_place or alone)[0]
        activated |= layer.type == 'ReLU'


def _keep_needed(graph, ends):
    needed, kept = {value for _, value in graph.outputs}, []
    for layer in reversed(graph.layers):
        if needed.intersection(layer.outputs) or (layer.type == 'Silence' and not ends):
            needed.update(layer.inputs)
            kept.append(layer)
    graph.layers = kept[::-1]
    graph.require_inputs()
