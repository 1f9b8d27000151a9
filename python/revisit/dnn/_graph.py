"""Layers of a net with the names and numbers that OpenCV gives them."""

import re
from collections import Counter

from .. import engine, proto


class Node:
    """A layer of OpenCV's: name, type, name of the layer in the prototxt, names of outputs (of a layer without: of its inputs)."""

    def __init__(self, name, type_, layer, ports):
        self.name, self.type, self.layer, self.ports = name, type_, layer, ports


class Graph:
    """The layers of a prototxt.

    text: prototxt in the current format; a repeated name of a layer has a number, as in OpenCV.
    inputs: names of input blobs. layers: without inputs, in order; the first has the number 1. As OpenCV's importer has it, a
    Convolution has the name of its output blob, unless another layer has it, and is a layer for each output.
    unread: numbers of the layers of which no layer reads an output. detections: names of DetectionOutput layers -> keep_top_k.
    crops: names of Crop layers without an offset.
    """

    def __init__(self, file):
        """file: a NetFile."""
        given, known, names, renamed = {name for name, _ in file.layers}, Counter(), [], []
        head, *parts = re.split(r'^layer \{\n', file.text(), flags=re.MULTILINE)
        for (name, _), part in zip(file.layers, parts):
            while (number := f'_{known[name]}' if known[name] else '') and name + number in given:
                known[name] += 1
            known[name] += 1
            names.append(name + number)
            quoted, rest = part.split('\n', 1) if part.startswith('  name: ') else ('  name: ""', part)
            renamed.append(f'{quoted[:-1]}{number}"\n{rest}')
        self.text = 'layer {\n'.join([head, *renamed])
        graph = proto.resolve(file.to_bytes())
        values = graph.values
        read = {value for node in graph.nodes for value in node.inputs}
        ports = {}  # value -> name of the output that is this value
        self.inputs, self.layers, self.unread = [], [], []
        for node in graph.nodes:
            if node.index < 0:  # shows a value again
                ports[node.outputs[0]] = ports.get(node.inputs[0])
                continue
            if node.type == 'Input':
                self.inputs += [values[value][0] for value in node.outputs]
                continue
            layer = names[node.index]
            own = [engine.port_name(layer, i) for i in range(len(node.outputs))]
            ports.update(zip(node.outputs, own))
            if node.type == 'Convolution' and all(values[value][0] == layer or values[value][0] not in given for value in node.outputs):
                made = [(values[value][0], [port], [value]) for value, port in zip(node.outputs, own)]
            else:
                made = [(layer, own or [ports[value] for value in node.inputs if value in ports], node.outputs)]
            for name, shown, written in made:
                self.layers.append(Node(name, node.type, layer, shown))
                if not read.intersection(written):
                    self.unread.append(len(self.layers))
        self.crops = [name for name, part in zip(names, parts) if '  type: "Crop"' in part and 'offset:' not in part]
        kept = {name: re.search(r'keep_top_k: (\d+)', part) for name, part in zip(names, parts)}
        self.detections = {node.layer: int(kept[node.layer][1]) if kept[node.layer] else 0
                           for node in self.layers if node.type == 'DetectionOutput'}

    def with_offsets(self, offsets):
        """Returns the prototxt with offsets (y, x) of Crop layers by name."""
        text = self.text
        for name, (y, x) in offsets.items():
            head = f'  name: "{name}"\n  type: "Crop"\n'
            text = text.replace(head, f'{head}  crop_param {{\n    axis: 2\n    offset: {y}\n    offset: {x}\n  }}\n')
        return text
