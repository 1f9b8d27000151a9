"""Export of Caffe networks to ONNX, with a comparison of outputs."""

import sys
import tempfile
from pathlib import Path

import numpy as np
import onnx
import onnxruntime
from google.protobuf import text_format
from onnx import TensorProto, helper

from . import compare, engine, files, weights
from revisit.errors import Error, InputError, UnsupportedError, UsageError
from .graph import Graph, Layer, resolve
from .onnx_builder import IR_VERSION, OPSET, Builder
from .onnx_layers import EMIT, Site, detections

AXES = ('n', 'c', 'h', 'w')
MAX_BYTES = 2**31 - 1  # limit of a protobuf file


def export(options):
    """Runs the command `onnx`."""
    with files.appearing(options.output) as [part]:
        write(options, part)
    print(f'{options.output}: {Path(options.output).stat().st_size} bytes')


def write(options, out):
    """Writes the model to `out` and compares outputs."""
    end, _, graft = options.end.partition('+')
    truncation = dict(end=end, graft=graft)
    with tempfile.TemporaryDirectory() as folder:
        prototxt = options.prototxt if options.end else before_detections(options.prototxt, folder)
        graph = resolve(engine.read_net(prototxt, keep_unread=True), **truncation)
        graph.require_unique_names()
        refuse_unknown(graph)
        blobs = weights.read(options.weights) if options.weights else {}
        inputs = compare.arrays(graph, options.input)
        file = options.weights and weights.for_engine(options.weights, folder)
        if file and options.float16:
            blobs = {name: [a.astype(np.float32) for a in arrays] for name, arrays in weights.to_float16(blobs).items()}
            file = Path(folder) / 'rounded.caffemodel'
            weights.write_caffemodel(file, blobs)

        def expected(arrays):
            return engine.forward(prototxt, file, arrays, **truncation)

        values = engine.layer_outputs(prototxt, file, inputs, **truncation)
        values = {value: values[port] for layer in graph.layers
                  for port, value in zip(layer.ports(), layer.outputs)}
        model, names = build(graph, blobs, values, inputs, options.fixed, options.float16)
        if model.ByteSize() > MAX_BYTES:
            raise Error(f'ONNX: expected at most 2^31-1 bytes, found {model.ByteSize()}; --float16 halves the size')
        require_valid(model)
        onnx.save(model, out)
        if options.check:
            _check_layers(graph, model, names, inputs, values)
            _check_boxes(graph, values)
            _check_outputs(out, graph, inputs, expected, options)


def require_valid(model):
    try:
        onnx.checker.check_model(model, full_check=True)
    except (onnx.checker.ValidationError, onnx.shape_inference.InferenceError) as error:
        raise compare.CheckFailed(f"check failed: ONNX's checker rejects the model: {_one_line(error)}") from None


FIELD_BOXES = 'BoxOutput', 'BoxGroupOutput'  # their overlaps are not NonMaxSuppression's


def before_detections(prototxt, folder):
    """Returns the prototxt, or one in `folder` truncated before FIELD_BOXES, with their inputs as outputs."""
    net = engine.read_net(prototxt, keep_unread=True)
    graph = resolve(net)
    cut = [layer for layer in graph.layers if layer.type in FIELD_BOXES and not any(map(graph.readers, layer.outputs))
           and all(graph.readers(value) == [layer] for value in layer.inputs)]
    if not cut:
        return prototxt
    for layer in cut:
        net.layer.remove(layer.message)
        print(f"note: layer '{layer.name}' ({layer.type}) cannot be exported to ONNX; the model ends before it, with the outputs "
              f'{", ".join(layer.message.bottom)}; decode and suppress boxes yourself', file=sys.stderr)
    front = Path(folder) / 'front.prototxt'
    front.write_text(text_format.MessageToString(net))
    return front


def refuse_unknown(graph):
    for layer in graph.layers:
        if layer.type != 'Input' and layer.type not in EMIT:
            raise UnsupportedError(f"layer '{layer.name}' ({layer.type}): this type cannot be exported to ONNX (supported types: "
                                   'docs/CONVERSION.md); truncate the net before it with --end')


def build(graph, blobs, values, inputs, fixed, float16=False):
    """Returns the ONNX model of a graph, and {value: tensor name}.

    blobs: {layer: arrays}.
    inputs, values: example inputs {blob: array} and the resulting values {value: array}.
    fixed: fix sizes to those of the example; otherwise all sizes that the network accepts.
    """
    g, names, declared = Builder(), {}, []
    shapes = {value: array.shape for value, array in values.items()}
    for layer in graph.layers:
        if layer.type == 'Input':
            for value in layer.outputs:
                names[value] = graph.blobs[value]
                declared.append(_input(names[value], inputs[names[value]].shape, fixed))
            continue
        site = Site(layer, [names[v] for v in layer.inputs], [shapes[v] for v in layer.inputs],
                    [values[v] for v in layer.outputs], blobs.get(layer.name, []), fixed)
        names.update(zip(layer.outputs, EMIT[layer.type](g, site)))
    outputs = _name_values(g, graph, names, {i.name for i in declared})
    fixed = fixed and not {'Filter', *detections.EMIT} & {layer.type for layer in graph.layers}  # the number of rows varies
    results = [helper.make_tensor_value_info(name, TensorProto.FLOAT, shapes[value] if fixed else [None] * len(shapes[value]))
               for name, value in outputs]
    tensors, casts = g.initializers(float16)
    onnx_graph = helper.make_graph(casts + g.nodes, 'caffe', declared, results, tensors)
    model = helper.make_model(onnx_graph, producer_name='revisit', ir_version=IR_VERSION,
                              opset_imports=[helper.make_opsetid('', OPSET)])
    return model, names


def _input(name, shape, fixed):
    sizes = list(shape)
    if not fixed:
        sizes = [f'{name}_{AXES[i] if len(shape) == 4 else i}' if i != 1 or len(shape) != 4 else size
                 for i, size in enumerate(shape)]
    return helper.make_tensor_value_info(name, TensorProto.FLOAT, sizes)


def _name_values(g, graph, names, taken):
    """Renames tensors to the names of outputs and layers, also in `names`. Returns the outputs as (name, value)."""
    outputs, new_names, made = [], {}, {name for node in g.nodes for name in node.output}
    for name, value in graph.outputs:
        unique = name if name not in taken else f'{name}.out'
        taken.add(unique)
        if names[value] in made and names[value] not in new_names:
            new_names[names[value]] = unique
        else:  # an input, a constant, or an output with two names
            g.nodes.append(helper.make_node('Identity', [names[value]], [unique], name=f'{unique}#same'))
        outputs.append((unique, value))
    for layer in graph.layers:
        for port, value in zip(layer.ports(), layer.outputs):
            if names[value] in made and names[value] not in new_names and port not in taken:
                new_names[names[value]] = port
                taken.add(port)
    for node in g.nodes:
        for field in (node.input, node.output):
            for i, name in enumerate(field):
                field[i] = new_names.get(name, name)
    for value, name in names.items():
        names[value] = new_names.get(name, name)
    return outputs


def with_every_layer(model, names, values):
    """Returns the model with every layer as an output, and {name: value of the engine}."""
    everything = onnx.ModelProto()
    everything.CopyFrom(model)
    made = {name for node in model.graph.node for name in node.output}
    expected = {name: values[value] for value, name in names.items() if name in made}
    known = {output.name for output in model.graph.output}
    everything.graph.output.extend(helper.make_tensor_value_info(name, TensorProto.FLOAT, None)
                                   for name in expected if name not in known)
    return everything, expected


def of_boxes(graph):
    """Returns the values that suppression of boxes decides: rounding before it may exchange, add or remove rows."""
    found = set()
    for layer in graph.layers:
        if layer.type in detections.EMIT or found.intersection(layer.inputs):
            found.update(layer.outputs)
    return found


def _check_boxes(graph, values):
    """Compares each layer that suppresses boxes alone, with the engine's values as inputs."""
    for layer in graph.layers:
        if layer.type not in detections.EMIT:
            continue
        given = list(dict.fromkeys(layer.inputs))
        part = Graph([Layer('given', 'Input', None, [], given), layer], [f'value {i}' for i in range(len(graph.blobs))],
                     [('boxes', layer.outputs[0])])
        inputs = {part.blobs[value]: values[value] for value in given}
        model, _ = build(part, {}, values, inputs, fixed=True)
        found = Model(model.SerializeToString()).run(inputs, ['boxes'])
        compare.require(f"layer '{layer.name}' with the engine's inputs", found, {'boxes': values[layer.outputs[0]]})


def _check_layers(graph, model, names, inputs, values):
    """Compares every layer, because a softmax or a threshold would hide differences of its input."""
    hidden = of_boxes(graph)
    everything, expected = with_every_layer(model, {value: name for value, name in names.items() if value not in hidden}, values)
    if expected:  # empty if the net only forwards its inputs
        found = Model(everything.SerializeToString()).run(inputs, list(expected))
        compare.require('every layer', found, expected)


def _check_outputs(file, graph, inputs, expected, options):
    model = Model(str(file))

    hidden = of_boxes(graph)
    boxes = {name for name, value in graph.outputs if value in hidden}

    def require(what, arrays, outputs):
        found = model.run(arrays, list(outputs))
        for name in boxes.intersection(outputs):
            _print_boxes(name, found[name], outputs[name])
        numbers = {name: array for name, array in outputs.items() if name not in boxes}
        if numbers:
            compare.require(what, found, numbers)
    require(f'ONNX Runtime {onnxruntime.__version__} and the engine', inputs, _named(graph, expected(inputs)))
    if options.fixed or any(value.endswith('.npy') for value in options.input):
        return
    for larger in _larger(inputs):
        try:
            outputs = _named(graph, expected(larger))
        except (UsageError, InputError):
            continue
        require('another size', larger, outputs)
        return
    print('not checked: another size, because the network accepts none')


def _print_boxes(name, found, expected):
    found, expected = found.reshape(-1, found.shape[-1]), expected.reshape(-1, expected.shape[-1])
    near = [bool((np.abs(found - row) <= compare.TOLERANCE * np.maximum(1, np.abs(row))).all(axis=1).any()) for row in expected]
    print(f"{name}: {sum(near)} of {len(expected)} rows of the engine are among ONNX Runtime's {len(found)}; "
          'rounding in the layers before may exchange boxes that score or overlap alike')


def _named(graph, outputs):
    inputs = compare.inputs_of(graph)
    return {(f'{name}.out' if name in inputs else name): outputs[name] for name, _ in graph.outputs}


def _larger(inputs):
    for grow in ((1, 0, 5, 7), (1, 0, 0, 0)):
        yield {blob: compare.random([size + more for size, more in zip(a.shape, grow if a.ndim == 4 else (1,) + (0,) * 9)], 7)
               for blob, a in inputs.items()}


class Model:
    """A model in ONNX Runtime, from a file name or bytes."""

    def __init__(self, model, threads=0):
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = threads  # 0: number of cores
        options.log_severity_level = 4  # errors are raised, too
        try:
            self._session = onnxruntime.InferenceSession(model, options, providers=['CPUExecutionProvider'])
        except Exception as error:  # ONNX Runtime raises many types
            raise compare.CheckFailed(f'check failed: ONNX Runtime cannot load the model: {_one_line(error)}') from None

    def output_names(self):
        return [output.name for output in self._session.get_outputs()]

    def run(self, inputs, names):
        """Runs the model on inputs {blob: array}. Returns {output: array}."""
        used = {i.name for i in self._session.get_inputs()}
        try:
            return dict(zip(names, self._session.run(names, {k: v for k, v in inputs.items() if k in used})))
        except Exception as error:
            raise compare.CheckFailed(f'check failed: ONNX Runtime cannot run the model: {_one_line(error)}') from None


def _one_line(error):
    return ' '.join(str(error).split())[:300]
