"""Net and the functions that read one, as in cv2.dnn."""

import functools
import os
import time
import warnings
from collections import OrderedDict
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import engine, proto
from .._shared import named, threads
from ..errors import InputError, UnsupportedError, UsageError
from ._graph import Graph, Node
from ._images import scalar

_MAX_RUNS = 4  # cached runs of other outputs or shapes; each has the memory of its blobs
_CPU_BACKENDS, _CPU_TARGETS = (0, 2, 3), (0, 10)  # default, OpenVINO, OpenCV; CPU, CPU_FP16
_NO_SHAPE = 'gives no shape for the input'  # the engine's message; setInput() gives one
_INPUT = '__NetInputLayer__'  # in the list of types; layer 0 has the type ''


_registered = {}  # type of layer -> class


def registerLayer(type: str, cls: Any) -> None:
    """Does as cv2.dnn_registerLayer for `Crop`: layers without an offset crop what cls(params, blobs) crops. Raises UnsupportedError for others."""
    if type != 'Crop':
        raise UnsupportedError(f"registerLayer: expected 'Crop', found '{type}'; revisit.caffe runs layers of type Python")
    _registered[type] = cls


def _offset_of(cls, shape, wanted):
    """Returns (y, x) of the first pixel that a registered Crop takes of an image of `shape`, where it shall have the shape `wanted`."""
    layer, grid = cls({}, []), np.arange(shape[2] * shape[3]).reshape(1, 1, *shape[2:])
    layer.getMemoryShapes([[1, 1, *shape[2:]], [1, 1, *wanted[2:]]])
    found = np.asarray(layer.forward([grid, np.zeros((1, 1, *wanted[2:]))])[0])
    y, x = divmod(int(found.flat[0]), shape[3])
    if not np.array_equal(found, grid[:, :, y : y + wanted[2], x : x + wanted[3]]):
        raise UnsupportedError(f'registerLayer: {cls.__name__} does not crop {shape} to {wanted}')
    return y, x


@functools.cache  # once
def _warn_of_gpu():
    warnings.warn('revisit.dnn runs on the CPU: setPreferableBackend() and setPreferableTarget() do nothing', stacklevel=3)


class Layer:
    """A layer of a net: `name`, `type`, `blobs`. Assigning to `blobs` sets the weights; a bias that is left out is 0."""

    preferableTarget = 0  # the CPU

    def __init__(self, net: 'Net', node: Node):
        self._net, self.name, self.type = net, node.name, node.type

    @property
    def blobs(self) -> tuple[NDArray[np.float32], ...]:
        """Copies of the weights."""
        return tuple(blob.copy() for blob in self._net._weights_of(self.name)) if self.type else ()

    @blobs.setter
    def blobs(self, arrays: Sequence[ArrayLike]) -> None:
        old = self._net._weights_of(self.name)
        if not len(old) - 1 <= len(arrays) <= len(old) or not len(arrays):
            raise UsageError(f"blobs: layer '{self.name}' has {len(old)} arrays of weights, found {len(arrays)}")
        for i, array in enumerate([*arrays, *(np.zeros_like(blob) for blob in old[len(arrays):])]):
            self._net.setParam(self.name, i, array)

    def outputNameToIndex(self, outputName: str) -> int:
        """Returns the number of an input, -1 for another name, for layer 0; else 0, because outputs of layers have no names."""
        inputs = self._net._inputs
        return 0 if self.type else inputs.index(outputName) if outputName in inputs else -1


class Net:
    """A Caffe network, as cv2.dnn.Net. readNetFromCaffe() makes one; Net() is empty.

    Outputs are known by names of layers, not of blobs. Not thread-safe.
    Errors are revisit.UsageError, InputError and UnsupportedError instead of cv2.error.
    """

    def __init__(self) -> None:
        self._known_graph: Any = None
        self._net: Any = None
        self._problem: Any = None
        self._blobs, self._shapes = {}, {}  # by names of inputs: arrays, shapes for loading
        self._missing = {}  # layer -> indices of weights that neither the file nor setParam() gave
        self._changed = {}  # layer -> index -> weights that setParam() has set since loading
        self._runs = OrderedDict()  # outputs, threads and shapes -> run of the engine
        self._last, self._ticks = None, 0  # the last run and its time

    def _take(self, file, weights, names):
        """file: a NetFile. weights: bytes of a caffemodel; None: those in the file. names: of both for messages."""
        self._known_graph = Graph(file)
        self._inputs = list(self._known_graph.inputs)  # setInputsNames() renames them
        self._names, self._content = names, file.to_bytes() if weights is None else weights
        try:
            self._load()
        except InputError as error:
            if _NO_SHAPE not in str(error):
                raise
        return self

    def _load(self):
        """Returns the engine's net, with the present weights."""
        if self._net is None:
            self._net = self._read()
        if self._changed:
            weights = {name: list(arrays) for name, arrays in self._net.weights.items()}
            for name, arrays in self._changed.items():
                for index, array in arrays.items():
                    weights[name][index] = array
            file = proto.parse_net(self._graph.text, allow_unknown_fields=True)
            file.set_weights(weights)
            self._net = engine.Net.load_from_memory(self._graph.text, file.to_bytes(), allow_unknown=True, inputs=self._net.inputs)
            self._changed.clear()
            self._runs.clear()
            self._last = None
        return self._net

    def _read(self):
        text, shapes = self._graph.text, {**self._shapes, **{name: blob.shape for name, blob in self._blobs.items()}}

        def read(**options):
            with named(*self._names):
                return engine.Net.load_from_memory(text, self._content, allow_unknown=True, inputs=shapes, **options)

        try:
            net = read()
        except InputError as error:
            if _NO_SHAPE in str(error):
                raise
            net = read(allow_missing=True)
            known = {name for name, n_arrays in proto.WeightsFile.from_bytes(self._content).layers if n_arrays}
            self._missing = {name: set(range(len(arrays))) for name, arrays in net.weights.items() if name not in known}
            self._problem = str(error)
        self._content = None
        return net

    @property
    def _graph(self):
        if self.empty():
            raise UsageError('this Net is empty; readNetFromCaffe() reads one')
        return self._known_graph

    def empty(self) -> bool:
        """Returns True for Net()."""
        return self._known_graph is None or not self._known_graph.layers

    def setInput(self, blob: ArrayLike, name: str = '', scalefactor: float = 1.0, mean: ArrayLike = ()) -> None:
        """Copies an input: (blob - mean) * scalefactor as float32, with the mean of up to 4 channels.

        name: of the input blob; '': the first. The shape may differ from that of the prototxt.
        """
        given = np.asarray(blob)
        if given.dtype.kind not in 'fiub':
            raise UsageError(f'setInput: expected numbers, found an array of {given.dtype}')
        values = given.astype(np.float32, order='C')
        mean = scalar(mean)
        if mean.any():
            channels = values.shape[1] if values.ndim > 1 else 1
            if channels > 4:
                raise UsageError(f'setInput: expected at most 4 channels with a mean, found {channels}')
            values -= mean[:channels].astype(np.float32).reshape(-1, *[1] * (values.ndim - 2))
        if scalefactor not in (None, 1):
            values *= np.float32(scalefactor)
        self._blobs[self._input(name)] = values

    def _input(self, name):
        """Returns the name of an input in the prototxt."""
        inputs = self._graph.inputs
        if name and name not in self._inputs:
            raise UsageError(f"no input '{name}'; expected one of {', '.join(self._inputs)}")
        return inputs[self._inputs.index(name) if name else 0]

    def _shape(self):
        """Returns the first input's shape in the prototxt; () if it has none."""
        return tuple(self._load().inputs[self._graph.inputs[0]]) if self._net else ()

    def setInputsNames(self, inputBlobNames: Sequence[str]) -> None:
        """Renames the inputs, in the order of the prototxt."""
        if len(inputBlobNames) != len(self._graph.inputs):
            raise UsageError(f'setInputsNames: expected {len(self._inputs)} names, found {len(inputBlobNames)}')
        self._inputs = list(inputBlobNames)

    def setInputShape(self, inputName: str, shape: Sequence[int]) -> None:
        """Sets the shape of an input that has none in the prototxt. setInput() needs no call of this."""
        self._shapes[self._input(inputName)] = tuple(int(n) for n in shape)

    def forward(self, outputName: str | Sequence[str] | None = '', outputBlobs: Any = None, *, outBlobNames: Sequence[str] | None = None) -> Any:
        """Runs the layers that the outputs need.

        Args:
            outputName: name of a layer, or list of names; '' or None: the last layer.
        Returns:
            The first output of the layer, a new array; for a list a tuple of them.
        """
        names = outputName if outBlobNames is None else outBlobNames
        if isinstance(names, str | None):
            return self._forward([self._node(names or len(self._graph.layers)).ports[:1]])[0][0]
        names = list(names) or [self._graph.layers[-1].name]
        return tuple(arrays[0] for arrays in self._forward([self._node(name).ports[:1] for name in names]))

    def forwardAndRetrieve(self, outBlobNames: Sequence[str]) -> tuple[tuple[NDArray[np.float32], ...], ...]:
        """Returns a tuple for each named layer, with all outputs of the layer."""
        return tuple(map(tuple, self._forward([self._node(name).ports for name in outBlobNames])))

    def forwardAsync(self, outputName: str = '') -> Any:
        """Raises UnsupportedError, as cv2.dnn does on a CPU."""
        raise UnsupportedError('forwardAsync: passes are synchronous; call forward() in a thread, which releases the GIL')

    def _forward(self, wanted):
        """wanted: lists of ports. Returns lists of arrays."""
        net = self._load()
        lacking = [name for name in self._graph.inputs if name not in self._blobs]
        if lacking:
            raise UsageError(f"forward: no values for the input '{lacking[0]}'; call setInput(blob, '{lacking[0]}')")
        ports = tuple(dict.fromkeys(port for some in wanted for port in some))
        key = ports, threads(), _registered.get('Crop'), *(blob.shape for blob in self._blobs.values())
        with named(*self._names):
            if key not in self._runs:
                while len(self._runs) >= _MAX_RUNS:
                    self._runs.popitem(last=False)
                shapes = {name: blob.shape for name, blob in self._blobs.items()}
                plan = self._cropping(net, shapes).truncated(list(ports)).plan(shapes, threads=threads())
                if any(self._missing.get(cost.name) for cost in plan.layers):
                    raise InputError(f'{self._problem}, or set them: net.getLayer(name).blobs = [...]')
                self._runs[key] = plan.run()
            self._runs.move_to_end(key)
            self._last = self._runs[key]
            begin = time.perf_counter_ns()
            self._last.forward(self._blobs)
            self._ticks = time.perf_counter_ns() - begin
        return [[self._output(port) for port in some] for some in wanted]

    def _cropping(self, net, shapes):
        """Returns the net with the offsets of a registered Crop."""
        if 'Crop' not in _registered or not self._graph.crops:
            return net
        sizes = {cost.name: cost.inputs for cost in net.plan(shapes, keep_all=True).layers}
        text = self._graph.with_offsets({name: _offset_of(_registered['Crop'], *sizes[name]) for name in self._graph.crops if name in sizes})
        file = proto.parse_net(text, allow_unknown_fields=True)
        file.set_weights(net.weights)
        return engine.Net.load_from_memory(text, file.to_bytes(), allow_unknown=True, inputs=net.inputs)

    def _output(self, port):
        """Returns a copy. Detections are sorted as in OpenCV: by image, then by confidence; zeros fill keep_top_k rows per image."""
        array = np.array(self._last.output(port))
        if port in self._graph.detections:
            rows = array.reshape(-1, 7)
            rows = rows[rows[:, 1] >= 0]  # the engine's row of -1 stands for none
            n_images = self._blobs[self._graph.inputs[0]].shape[0]
            array = np.zeros((1, 1, max(self._graph.detections[port] * n_images, len(rows), 1), 7), np.float32)
            array[0, 0, : len(rows)] = rows[np.lexsort((-rows[:, 2], rows[:, 0]))]
        return array

    def _node(self, which):
        """which: the name or number of a layer."""
        number = self.getLayerId(which) if isinstance(which, str) else int(which)
        if not 1 <= number <= len(self._graph.layers):
            raise UsageError(f"no layer {which!r}; cv2.dnn knows outputs by names of layers, not of blobs: getLayerNames()")
        return self._graph.layers[number - 1]

    def getLayerNames(self) -> tuple[str, ...]:
        """Returns the names of all layers but inputs. A repeated name has a number: relu, relu_1."""
        return () if self.empty() else tuple(layer.name for layer in self._graph.layers)

    def getLayerId(self, layer: str) -> int:
        """Returns the number of a layer, from 1; -1 if there is none of the name."""
        names = ('_input', *self.getLayerNames())
        return names.index(layer) if layer in names else -1

    def getLayer(self, layerId: str | int) -> Layer:
        """Returns a layer by name or number: `name`, `type`, `blobs`. Number 0 stands for the inputs."""
        return Layer(self, Node('_input', '', '', []) if layerId in (0, '_input') else self._node(layerId))

    def getUnconnectedOutLayers(self) -> NDArray[np.int32]:
        """Returns the numbers of the layers of which no layer reads an output, int32."""
        return np.array(self._graph.unread, np.int32)

    def getUnconnectedOutLayersNames(self) -> tuple[str, ...]:
        """Returns the names of the layers of which no layer reads an output."""
        return tuple(self._node(number).name for number in self.getUnconnectedOutLayers())

    def getLayerTypes(self) -> tuple[str, ...]:
        """Returns the types of the layers, sorted, each once."""
        return tuple(sorted({layer.type for layer in self._graph.layers} | {_INPUT}))

    def getLayersCount(self, layerType: str) -> int:
        """Returns the number of layers of a type."""
        return sum(layer.type == layerType for layer in self._graph.layers) + (layerType == _INPUT)

    def _weights_of(self, layer):
        """Returns views of the weights in OpenCV's shapes."""
        node = self._node(layer)
        return [_shaped(node, i, blob) for i, blob in enumerate(self._load().weights.get(node.layer, ()))]

    def getParam(self, layer: str | int, numParam: int = 0) -> NDArray[np.float32]:
        """Returns weights of a layer, by its name or number: a copy of array `numParam`."""
        blobs = self._weights_of(layer)
        if not 0 <= numParam < len(blobs):
            raise UsageError(f"layer '{self._node(layer).name}' has {len(blobs)} arrays of weights, none of index {numParam}")
        return blobs[numParam].copy()

    def setParam(self, layer: str | int, numParam: int, blob: ArrayLike) -> None:
        """Sets array `numParam` of the weights of a layer, of any shape with as many values."""
        name, array = self._node(layer).layer, np.asarray(blob, np.float32)
        self.getParam(layer, numParam)
        arrays = self._net.weights[name]
        if array.size != arrays[numParam].size:
            raise UsageError(f"setParam: layer '{name}': expected {arrays[numParam].size} values, found the shape {array.shape}")
        self._changed.setdefault(name, {})[numParam] = array.reshape(arrays[numParam].shape).copy()
        self._missing.get(name, set()).discard(numParam)

    def _costs(self, layer_and_shapes):
        """Returns the input shapes, the layers meant (all, or the one of a number before the shapes), and the engine's costs by name."""
        if not layer_and_shapes or not len(layer_and_shapes[-1]):
            raise UsageError('expected a shape for each input, found none')
        *layer, shapes = layer_and_shapes
        shapes = [shapes] if np.ndim(shapes[0]) == 0 else shapes
        if self._net is None:  # the prototxt has none
            self._shapes.update(zip(self._graph.inputs, map(tuple, shapes)))
        with named(*self._names):
            plan = self._load().plan(dict(zip(self._graph.inputs, map(tuple, shapes))), keep_all=True)
        return shapes, [self._node(number) for number in layer] or self._graph.layers, {cost.name: cost for cost in plan.layers}

    def getFLOPS(self, *arguments: Any) -> int:
        """Returns 2 for each multiplication with addition. Arguments: input shapes, or number of a layer and input shapes."""
        _, nodes, costs = self._costs(arguments)
        return sum(2 * costs[node.layer].macs for node in nodes if node.layer in costs)

    def getMemoryConsumption(self, *arguments: Any) -> tuple[int, int]:
        """Returns the bytes of weights and of outputs; arguments as of getFLOPS()."""
        shapes, nodes, costs = self._costs(arguments)
        weights = sum(blob.nbytes for node in nodes for blob in self._weights_of(node.name))
        outputs = [shape for node in nodes if node.layer in costs for shape in costs[node.layer].outputs]
        outputs += shapes if len(arguments) == 1 else []
        return weights, sum(4 * int(np.prod(shape)) for shape in outputs)

    def getLayersShapes(self, netInputShapes: Any) -> tuple[NDArray[np.int32], Any, Any]:
        """Returns the numbers of all layers, 0 for the inputs, and tuples of the shapes of their inputs and outputs, int32 arrays."""
        shapes, nodes, costs = self._costs([netInputShapes])
        known = [(costs[node.layer].inputs, costs[node.layer].outputs) if node.layer in costs else ((), ()) for node in nodes]
        sides = zip((shapes, shapes), *known)
        arrays = [tuple(tuple(np.array(shape, np.int32) for shape in some) for some in side) for side in sides]
        return np.arange(len(nodes) + 1, dtype=np.int32), *arrays

    def getPerfProfile(self) -> tuple[int, NDArray[np.float64]]:
        """Returns the time of the last forward() and the times of its layers in another pass [ns, the ticks of cv2]."""
        times = dict.fromkeys((node.layer for node in self._graph.layers), 0.0)
        if self._last is not None:
            profile = engine.profile(self._last, warmup=0, repeat=1)
            for cost, timing in zip(self._last.plan.layers, profile.layers):
                times[cost.name] = timing.median * 1e6
        return self._ticks, np.array([times[node.layer] for node in self._graph.layers])

    def setPreferableBackend(self, backendId: int) -> None:
        """Warns once for a backend of GPUs, because nets run on the CPU."""
        if backendId not in _CPU_BACKENDS:
            _warn_of_gpu()

    def setPreferableTarget(self, targetId: int) -> None:
        """Warns once for a GPU, because nets run on the CPU."""
        if targetId not in _CPU_TARGETS:
            _warn_of_gpu()

    def enableFusion(self, fusion: bool) -> None:
        """Does nothing: layers are fused wherever no output is asked for."""

    def enableWinograd(self, useWinograd: bool) -> None:
        """Does nothing: Winograd's algorithm is used where it is faster and accurate."""


def _shaped(layer, index, blob):
    """Returns the view of a bias that has OpenCV's shape."""
    if index == 1 and layer.type == 'InnerProduct':
        return blob.reshape(1, -1)
    return blob.reshape(-1, 1) if blob.ndim == 1 else blob


def _is_buffer(source):
    return isinstance(source, (bytes, bytearray, memoryview, np.ndarray, list))


def _content(source):
    """Returns the bytes of a buffer."""
    return np.asarray(source, np.uint8).tobytes() if isinstance(source, (np.ndarray, list)) else bytes(source)


def readNetFromCaffe(prototxt: Any = None, caffeModel: Any = '', *, bufferProto: Any = None, bufferModel: Any = None) -> Net:
    """Reads a Caffe network.

    Args:
        prototxt: path, or content as bytes, bytearray or uint8 array (bufferProto).
        caffeModel: the weights in the same way (bufferModel); '': the net has names and shapes, but cannot run.
    Raises:
        revisit.InputError: the files cannot be read, do not parse, or do not match.
        revisit.UnsupportedError: the engine lacks a layer type.
    """
    prototxt, caffeModel = (b if a is None else a for a, b in ((bufferProto, prototxt), (bufferModel, caffeModel)))
    if _is_buffer(prototxt):
        text_name = '<prototxt>'
        file = proto.parse_net(_content(prototxt).decode('utf-8', 'surrogateescape'), allow_unknown_fields=True)
    else:
        text_name = os.fspath(prototxt)
        file = proto.read_net(text_name, allow_unknown_fields=True)
    for note in file.warnings:
        if 'Crop' not in _registered or 'has no crop_param' not in note:
            warnings.warn(note, stacklevel=2)
    if _is_buffer(caffeModel):
        weights, name = _content(caffeModel) or None, '<weights>'
    elif not caffeModel:
        weights, name = None, text_name
    else:
        name = os.fspath(caffeModel)
        try:
            with open(name, 'rb') as opened:
                weights = opened.read()
        except OSError as error:
            raise InputError(f'{name}: cannot be read ({error.strerror}); give the path of the caffemodel') from None
    return Net()._take(file, weights, (text_name, name))


def readNet(model: Any, config: Any = '', framework: Any = '') -> Net:
    """Reads a Caffe network from a caffemodel and a prototxt, in any order, or readNet('caffe', bufferModel, bufferConfig)."""
    if _is_buffer(config):  # framework, bufferModel, bufferConfig
        model, config, framework = config, framework, model
    elif str(model).endswith('.prototxt') or str(config).endswith('.caffemodel'):
        model, config = config, model
    if framework and framework.lower() != 'caffe':
        raise UnsupportedError(f"readNet: expected the framework 'caffe', found '{framework}'; cv2.dnn reads the others")
    if not _is_buffer(model) and not config:
        raise UsageError(f"readNet: expected a caffemodel and a prototxt, found only '{model}'")
    return readNetFromCaffe(config, model)
