"""caffe.Net: a network with its weights, and the blobs it computes."""

import itertools
import os
import warnings
from collections import OrderedDict

import numpy as np

from ..errors import Error, InputError
from . import _engine, _scripts, _structure, _weights
from ._blob import Blob, BlobVec  # noqa: F401  scripts use caffe._caffe.BlobVec
from ._engine import Ranges
from ._scripts import Layer  # noqa: F401
from .proto import caffe_pb2


class TrainingError(NotImplementedError):
    """A script uses training: gradients, solvers, the TRAIN phase.

    This package only runs trained networks. Train with the original Caffe, then load its caffemodel.
    """

    def __init__(self, what):
        super().__init__(
            f'{what}: gradients are not computed, because this package only runs trained networks; train with the original '
            'Caffe and load the caffemodel with caffe.Net(prototxt, caffe.TEST, weights=...); for gradients of an input '
            '(DeepDream, Grad-CAM), convert the net with `revisit-convert onnx` and load it in PyTorch'
        )


def _is_path(value):
    return isinstance(value, (str, bytes, os.PathLike))


def _no_detections(n_images):
    """Returns SSD's output without detections: one row of -1 per image, with the image's index."""
    rows = np.full((1, 1, n_images, 7), -1, np.float32)
    rows[0, 0, :, 0] = np.arange(n_images)
    return rows


class Net:
    """A Caffe network on the CPU, in pycaffe's interface.

    Net(prototxt, caffe.TEST, level=0, stages=None, weights=None), or in old scripts Net(prototxt, weights, caffe.TEST).
    Without weights, layers are initialized by their fillers.

    Attributes of pycaffe: blobs, params, layers, layer_dict, inputs, outputs, top_names, bottom_names.
    Not thread-safe. A net in the phase caffe.TRAIN has names and weights, but cannot run.

    Raises:
        revisit.InputError: files cannot be read, do not parse, or do not match.
        revisit.UnsupportedError: the engine lacks a layer type.
    """

    def __init__(self, network_file, *args, **kwargs):
        has_weights = bool(args) and _is_path(args[0])
        if (len(args) != 2 or kwargs) if has_weights else not args and 'phase' not in kwargs:
            raise TypeError(
                'expected Net(prototxt, phase), Net(prototxt, phase, weights=weights) or Net(prototxt, weights, phase), '
                'where the phase is caffe.TEST'
            )
        if has_weights:
            self._create(network_file, phase=args[1], weights=args[0])
        else:
            self._create(network_file, *args, **kwargs)

    def _create(self, network_file, phase, level=0, stages=None, weights=None):
        if phase not in (caffe_pb2.TEST, caffe_pb2.TRAIN):
            raise ValueError(f'expected the phase caffe.TEST or caffe.TRAIN, found {phase!r}')
        self._phase = phase
        self._prototxt = os.fsdecode(network_file)
        net, notes = _engine.read_net(self._prototxt, phase, level, list(stages or ()))
        for note in notes:
            warnings.warn(note, stacklevel=4)
        self._name = net.name
        self.layers, self._copies, views = _structure.with_splits(net, self._prototxt)
        self._layer_names = [layer.name for layer in self.layers]
        self._blob_names = list(dict.fromkeys(top for layer in self.layers for top in layer.tops))  # by first writer
        self.inputs = [top for layer in self.layers if layer.type == 'Input' for top in layer.tops]
        self.outputs = _structure.outputs(self.layers)
        self._callbacks = [], []  # before and after each layer
        self._batches = None  # start indices of the next batches of _images; see set_input_arrays()
        self.blobs = OrderedDict()
        self._make_inputs(net.layer, views)
        self._detectors = {layer.tops[0]: layer.bottoms[0] for layer in self.layers
                           if layer.type == 'DetectionOutput'}
        self._set_up_scripts()
        blobs = self.blobs  # capturing self would create a reference cycle and delay deletion of the net
        self._ranges = Ranges(self.layers, lambda name: blobs[name].shape, self._prototxt)
        file = None if weights is None else _engine.WeightsFile(weights)
        self._weights = _weights.NetWeights(self.layers, self._ranges, file)
        self.reshape()

    def _make_inputs(self, messages, views):
        """Creates blobs in pycaffe's order. Sets the shapes of those of Input layers."""
        shapes = {}
        for message in messages:
            if message.type != 'Input':
                continue
            given = message.input_param.shape
            for i, blob in enumerate(message.top):
                if not given:
                    raise InputError(
                        f"{self._prototxt}: input '{blob}' (layer '{message.name}') has no shape; "
                        'add input_param { shape { dim: ... } } to an Input layer'
                    )
                shapes[blob] = tuple(given[i if len(given) > 1 else 0].dim)
                if min(shapes[blob], default=1) < 1:
                    raise InputError(
                        f"{self._prototxt}: input '{blob}' (layer '{message.name}'): expected sizes of at least 1, "
                        f'found {list(shapes[blob])}'
                    )
        for name in self._blob_names:
            # As in Caffe, the outputs of a Split share the memory of its input.
            source = self._copies.get(name)
            shares = self.blobs[views[name]] if name in views else None
            self.blobs[name] = self.blobs[source] if source else Blob(shapes.get(name, (0,)), shares=shares)

    def _set_up_scripts(self):
        """Creates the layers that run in Python, which set the shapes of their outputs."""
        if all(layer.type not in _structure.IN_PYTHON for layer in self.layers):
            return
        for step in _structure.steps(self.layers, 0, len(self.layers) - 1):
            if isinstance(step, _structure.Layer):
                step.message.phase = self._phase
                step.script = _scripts.make(step.message, self._prototxt)
                step.blobs = step.script.blobs
                step.script.setup(*self._blobs_of(step))
                step.script.reshape(*self._blobs_of(step))
                continue
            layers = self.layers[step[0] : step[1] + 1]
            ranges = Ranges(layers, lambda name: self.blobs[name].shape, self._prototxt)
            ranges.load({})
            self._take_shapes(ranges, ranges.part(0, len(layers) - 1))

    def _blobs_of(self, layer):
        return [[self.blobs[name] for name in names] for names in (layer.bottoms, layer.tops)]

    def copy_from(self, weights):
        """Copies weights of a .caffemodel or HDF5 file to the layers of the same names.

        Ignores layers of the file that the net lacks. Warns about layers that the file lacks, which keep their weights.

        Raises:
            OSError: the file cannot be read.
            revisit.InputError: the file is not a weights file, or the weights of a layer do not match.
        """
        self._weights.copy_from(_engine.WeightsFile(weights))

    def share_with(self, other):
        """Shares the weights of the layers of `other` with the same names.

        Raises:
            ValueError: layers of one name have weights of different shapes.
        """
        self._weights.share_with(other._weights)

    def save(self, path):
        """Writes a caffemodel of all layers and weights atomically.

        Raises:
            OSError: the file cannot be written.
        """
        layers = []
        for layer in self.layers:
            message = caffe_pb2.LayerParameter()
            if layer.message is not None:
                message.CopyFrom(layer.message)
            message.name, message.type, message.phase = layer.name, layer.type, self._phase
            for field, names in (('bottom', layer.bottoms), ('top', layer.tops)):
                message.ClearField(field)
                getattr(message, field).extend(names)
            message.ClearField('blobs')
            layers.append((message, [blob.read() for blob in layer.blobs]))
        try:
            _weights.net_file(self._name, layers).write_binary(os.fsdecode(path))
        except Error as error:
            raise OSError(str(error)) from None

    def save_hdf5(self, path):
        """Writes the weights as an HDF5 file in Caffe's layout. Needs the package h5py."""
        try:
            import h5py
        except ImportError as error:
            raise ImportError('save_hdf5() needs the package h5py: pip install h5py') from error
        with h5py.File(path, 'w') as file:
            data = file.create_group('data')
            for layer in self.layers:
                if layer.blobs:
                    group = data.create_group(layer.name)
                    for i, blob in enumerate(layer.blobs):
                        group.create_dataset(str(i), data=blob.read())

    load_hdf5 = copy_from  # also reads HDF5 files

    @property
    def params(self):
        """Weights: layer name -> list of blobs, for layers with weights."""
        return OrderedDict((layer.name, layer.blobs) for layer in self.layers if layer.blobs)

    @property
    def layer_dict(self):
        """Layer name -> layer."""
        return OrderedDict(zip(self._layer_names, self.layers))

    @property
    def top_names(self):
        """Layer name -> names of its outputs."""
        return OrderedDict((layer.name, layer.tops) for layer in self.layers)

    @property
    def bottom_names(self):
        """Layer name -> names of its inputs."""
        return OrderedDict((layer.name, layer.bottoms) for layer in self.layers)

    @property
    def blob_loss_weights(self):
        """Loss weight of each blob: 0, because losses are for training."""
        return OrderedDict((name, 0.0) for name in self._blob_names)

    @property
    def _blobs(self):
        return list(self.blobs.values())

    @property
    def _inputs(self):
        return [self._blob_names.index(name) for name in self.inputs]

    @property
    def _outputs(self):
        return [self._blob_names.index(name) for name in self.outputs]

    def _top_ids(self, layer):
        return [self._blob_names.index(name) for name in self.layers[layer].tops]

    def _bottom_ids(self, layer):
        return [self._blob_names.index(name) for name in self.layers[layer].bottoms]

    def _take_shapes(self, ranges, part):
        if part is not None:
            for blob, shape in ranges.shapes(part, self.blobs).items():
                self.blobs[blob].become(shape)

    def reshape(self):
        """Infers the shapes of all blobs from those of the inputs."""
        self._weights.update()
        for step in _structure.steps(self.layers, 0, len(self.layers) - 1):
            if isinstance(step, _structure.Layer):
                step.script.reshape(*self._blobs_of(step))
                continue
            self._take_shapes(self._ranges, self._ranges.part(*step))

    def before_forward(self, function):
        """Calls function(index of the layer) before each layer of later passes. The layers then run one by one."""
        self._callbacks[0].append(function)

    def after_forward(self, function):
        """Calls function(index of the layer) after each layer of later passes. The layers then run one by one."""
        self._callbacks[1].append(function)

    def _forward(self, first, last):
        """Runs layers first to last, inclusive. Returns the loss: 0, because losses are for training."""
        if self._phase == caffe_pb2.TRAIN:
            raise TrainingError('forward() of a net in the phase caffe.TRAIN')
        self._weights.update()
        if first == 0 and self._batches is not None:
            self._take_batch()
        if not any(self._callbacks):
            return self._run_layers(first, last)
        for layer in range(first, last + 1):
            for function in self._callbacks[0]:
                function(layer)
            self._weights.update()
            self._run_layers(layer, layer)
            for function in self._callbacks[1]:
                function(layer)
        return 0.0

    def _run_layers(self, first, last):
        for step in _structure.steps(self.layers, first, last):
            if isinstance(step, _structure.Layer):
                blobs = self._blobs_of(step)
                step.script.reshape(*blobs)
                step.script.forward(*blobs)
                continue
            part = self._ranges.part(*step)
            if part is not None:
                self._run(part)
        return 0.0

    def _run(self, part):
        for blob, array in self._ranges.forward(part, self.blobs).items():
            if array.size == 0 and blob in self._detectors:
                array = _no_detections(self.blobs[self._detectors[blob]].shape[0])
            self.blobs[blob].take(array)

    def _index(self, layer):
        if layer not in self._layer_names:
            raise ValueError(f"Net: no layer '{layer}'; expected one of {', '.join(self._layer_names)}")
        return self._layer_names.index(layer)

    def forward(self, blobs=None, start=None, end=None, **inputs):
        """Runs the net, or the layers from `start` to `end`.

        Args:
            blobs: names of additional blobs to return.
            start, end: names of the first and last layer. They read the current values of blobs.
            inputs: input name -> array, for all inputs; or none to use the current values.
        Returns:
            Name -> array of the net's outputs (or those of `end`). The arrays are views of blobs, which the next pass
            overwrites.
        """
        first = 0 if start is None else self._index(start)
        last = len(self.layers) - 1 if end is None else self._index(end)
        wanted = list(self.outputs if end is None else self.layers[last].tops) + list(blobs or ())
        if inputs:
            self._set_inputs(inputs)
        self._forward(first, last)
        return {name: self.blobs[name].data for name in dict.fromkeys(wanted)}

    def _set_inputs(self, inputs):
        if set(inputs) != set(self.inputs):
            raise ValueError(f'expected arrays for the inputs {sorted(self.inputs)}, found {sorted(inputs)}')
        for name, array in inputs.items():
            blob, found = self.blobs[name], np.shape(array)
            if not found or not blob.shape or found[0] != blob.shape[0]:
                raise ValueError(f"input '{name}': expected a batch of shape {blob.shape}, found {list(found)}")
            blob.data[...] = array
        self._batches = None

    def forward_all(self, blobs=None, **inputs):
        """Runs the net on any number of images in batches.

        Args:
            blobs: names of additional blobs to return.
            inputs: input name -> array or list of images.
        Returns:
            Blob name -> array with one row per image, copied.
        """
        if not inputs:
            raise ValueError(f'expected arrays for the inputs {sorted(self.inputs)}, found none')
        n_images = len(next(iter(inputs.values())))
        n_padding = -n_images % next(iter(self.blobs.values())).shape[0]
        collected = {name: [] for name in dict.fromkeys([*self.outputs, *(blobs or ())])}
        for batch in self._batch(inputs):
            for name, values in self.forward(blobs=blobs, **batch).items():
                collected[name].extend(values.copy())
        n_rows = max(1, n_images + n_padding)  # 0 images make no batch
        return {name: np.asarray(rows[: len(rows) * n_images // n_rows]) for name, rows in collected.items()}

    def _batch(self, inputs):
        """Pads the last batch with zeros."""
        n_images = len(next(iter(inputs.values())))
        size = next(iter(self.blobs.values())).shape[0]
        for begin in range(0, n_images, size):
            batch = {}
            for name, images in inputs.items():
                rows = np.asarray(images[begin : begin + size])
                missing = size - len(rows)
                batch[name] = np.concatenate([rows, np.zeros((missing, *rows.shape[1:]))]) if missing else rows
            yield batch

    def set_input_arrays(self, data, labels):
        """Sets the images of a MemoryData layer (an input here). Each forward() uses the next batch, cyclically.

        Calling forward() with arrays ends this.

        Args:
            data: [n][c][h][w], where n is a multiple of the layer's batch size.
            labels: [n][1][1][1] or [n]; ignored if no layer reads labels.
        Raises:
            ValueError: the arrays do not match the layer.
        """
        if self.layers[0].type != 'Input':
            raise ValueError('set_input_arrays: expected a net whose first layer is a MemoryData layer')
        data, labels = np.asarray(data, np.float32), np.asarray(labels, np.float32)
        size, *image = self.blobs[self.inputs[0]].shape
        if list(data.shape[1:]) != image or len(data) == 0 or len(data) % size:
            raise ValueError(
                f"input '{self.inputs[0]}': expected images of shape {image}, their number a multiple of the batch size "
                f'{size}, found {list(data.shape)}'
            )
        if labels.size != len(data):
            raise ValueError(f'set_input_arrays: expected {len(data)} labels, one per image, found {labels.size}')
        self._batches = itertools.cycle(range(0, len(data), size))
        self._images = [data, labels.reshape(-1)][: len(self.inputs)]

    def _take_batch(self):
        begin = next(self._batches)
        for name, array in zip(self.inputs, self._images):
            blob = self.blobs[name]
            blob.data[...] = array[begin : begin + blob.shape[0]].reshape(blob.shape)

    def backward(self, diffs=None, start=None, end=None, **gradients):
        """Raises TrainingError."""
        raise TrainingError('Net.backward()')

    _backward = backward

    def before_backward(self, function):
        """Raises TrainingError."""
        raise TrainingError('Net.before_backward()')

    after_backward = before_backward

    def forward_backward_all(self, blobs=None, diffs=None, **inputs):
        """Raises TrainingError."""
        raise TrainingError('Net.forward_backward_all()')

    def clear_param_diffs(self):
        """Sets the gradients of all weights to zero."""
        for layer in self.layers:
            for blob in layer.blobs:
                blob.diff[...] = 0
