"""A network as layers that read and write values. Every value is written once, also where layers work in place."""

from dataclasses import dataclass, field
from difflib import get_close_matches

from .errors import InputError, UnsupportedError, UsageError


@dataclass
class Layer:
    """One layer; `inputs` and `outputs` are numbers of values."""

    name: str
    type: str
    message: object  # LayerParameter
    inputs: list = field(default_factory=list)
    outputs: list = field(default_factory=list)

    def ports(self):
        """The names of its outputs, as the engine gives them: 'layer', then 'layer.1'."""
        return [self.name if i == 0 else f'{self.name}.{i}' for i in range(len(self.outputs))]


@dataclass
class Graph:
    """Layers in the order of the file; `blobs[v]` is the name of value v; `outputs` are pairs (name, value)."""

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
        """Legal in Caffe, but weights and outputs are known by the names of layers."""
        names = set()
        for layer in self.layers:
            if layer.name in names:
                raise UnsupportedError(f"two layers are named '{layer.name}': give each layer a name of its own")
            names.add(layer.name)

    def readers(self, value):
        return [layer for layer in self.layers if value in layer.inputs]


def resolve(net):
    """The graph of a NetParameter of the current format. An input that no layer writes is None."""
    graph, current = Graph(), {}
    for message in net.layer:
        layer = Layer(message.name, message.type, message)
        layer.inputs = [current.get(blob) for blob in message.bottom]
        for blob in message.top:
            current[blob] = len(graph.blobs)
            layer.outputs.append(len(graph.blobs))
            graph.blobs.append(blob)
        graph.layers.append(layer)
    read = {value for layer in graph.layers for value in layer.inputs}
    graph.outputs = [(blob, value) for value, blob in enumerate(graph.blobs) if value not in read]
    return graph


def truncate(graph, end, graft):
    """Cuts the graph off after the layer `end` and appends a copy of the layer `graft`, as the engine does."""
    if graft and not end:
        raise UsageError('--graft needs --end: the layer to graft onto')
    if end:
        last = graph.find(end, '--end')
        graph.outputs = list(zip(last.ports(), last.outputs))
        if graft:
            source = graph.find(graft, '--graft')
            if len(source.inputs) != 1 or len(source.outputs) != 1 or len(last.outputs) != 1:
                raise UsageError(f"--graft: '{graft}' and '{end}' must have one input and one output")
            copy = Layer(f'{end}+{graft}', source.type, source.message,
                         [_after_relu(graph, last.outputs[0])], [len(graph.blobs)])
            graph.blobs.append(copy.name)
            graph.layers.append(copy)
            graph.outputs = [(copy.name, copy.outputs[0])]
    _keep_needed(graph, bool(end))
    graph.require_unique_names()
    return graph


def _after_relu(graph, value):
    readers = graph.readers(value)
    relus = [layer for layer in readers if layer.type == 'ReLU']
    in_place = [layer for layer in relus if layer.message.bottom[:1] == layer.message.top[:1]]
    if in_place:
        return in_place[-1].outputs[0]
    return relus[0].outputs[0] if relus and len(readers) == 1 else value


def _keep_needed(graph, ends):
    needed, kept = {value for _, value in graph.outputs}, []
    for layer in reversed(graph.layers):
        if needed.intersection(layer.outputs) or (layer.type == 'Silence' and not ends):
            needed.update(layer.inputs)
            kept.append(layer)
    graph.layers = kept[::-1]
    for layer in graph.layers:
        if None in layer.inputs:
            blob = layer.message.bottom[layer.inputs.index(None)]
            raise InputError(f"layer '{layer.name}': bottom '{blob}' is written by no layer before it")
