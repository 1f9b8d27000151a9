"""caffe.Net: a network with its weights, and the blobs it computes."""

import itertools
import os
import warnings
from collections import OrderedDict

import numpy as np

from revisit._core.proto import write_atomically

from ..errors import Error, InputError
from . import _caffemodel, _engine, _scripts, _structure
from ._blob import Blob
from ._net_weights import NetWeights
from ._ranges import Range, Ranges
from .errors import TrainingError
from .proto import caffe_pb2


def _is_path(value):
    return isinstance(value, (str, bytes, os.PathLike))


def _no_detections(n_images):
    """What SSD's DetectionOutput writes then: a row of -1 for each image, with the image's index."""
    rows = np.full((1, 1, n_images, 7), -1, np.float32)
    rows[0, 0, :, 0] = np.arange(n_images)
    return rows


class Net:
    """A Caffe network on the CPU, as pycaffe has it.

    Net(prototxt, caffe.TEST, level=0, stages=None, weights=None), or as old scripts write it
    Net(prototxt, weights, caffe.TEST). Without weights, layers have what their fillers say.

    Attributes that pycaffe has, too: blobs, params, layers, layer_dict, inputs, outputs, top_names, bottom_names.
    A net is for one thread at a time. Of a net in the phase caffe.TRAIN only names and weights can be used.

    Raises:
        revisit.InputError: files that cannot be read, do not parse, or do not fit each other.
        revisit.UnsupportedError: a type of layer that the engine lacks.
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
        self.layers, self._copies = _structure.with_splits(net.layer, self._prototxt)
        self._layer_names = [layer.name for layer in self.layers]
        self._blob_names = _structure.blob_names(self.layers)
        self.inputs = _structure.inputs(self.layers)
        self.outputs = _structure.outputs(self.layers)
        self._batches = None  # where the next batches of _images begin: set_input_arrays()
        self.blobs = OrderedDict()
        self._make_inputs(net.layer)
        self._detectors = {layer.tops[0]: layer.bottoms[0] for layer in self.layers
                           if layer.type == 'DetectionOutput'}
        self._set_up_scripts()
        blobs = self.blobs  # not self: a net goes when the script lets go of it, without a cycle
        self._ranges = Ranges(self.layers, lambda name: blobs[name].shape, self._prototxt)
        file = None if weights is None else _engine.WeightsFile(weights)
        self._weights = NetWeights(self.layers, self._ranges.whole, file)
        self.reshape()

    def _make_inputs(self, messages):
        """Blobs in pycaffe's order; those of Input layers have their shapes."""
        shapes = {}
        for message in messages:
            if message.type != 'Input':
                continue
            given = message.input_param.shape
            for i, blob in enumerate(message.top):
                if not given:
                    raise InputError(
                        f"{self._prototxt}: the file does not say the shape of the input '{blob}' (layer "
                        f"'{message.name}'); add input_param {{ shape {{ dim: ... }} }} in an Input layer"
                    )
                shapes[blob] = tuple(given[i if len(given) > 1 else 0].dim)
        views = _structure.views(self.layers)
        for name in self._blob_names:
            # A copy that a Split makes is the same memory as what it is a copy of, as in Caffe.
            source = self._copies.get(name)
            shares = self.blobs.get(views[name].message.bottom[0]) if name in views else None
            self.blobs[name] = self.blobs[source] if source else Blob(shapes.get(name, (0,)), shares=shares)

    def _set_up_scripts(self):
        """Makes the layers that run in Python, which say the shapes of what they write."""
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
            layers = _structure.computing(self.layers[step[0] : step[1] + 1])
            if layers:
                range_ = Range(layers, lambda name: self.blobs[name].shape, self._prototxt)
                range_.load({})
                self._take_shapes(range_)

    def _blobs_of(self, layer):
        return [[self.blobs[name] for name in names] for names in (layer.bottoms, layer.tops)]

    # -- Weights.

    def copy_from(self, weights):
        """Takes the weights of the layers that a .caffemodel or HDF5 file has, by name.

        Layers of the file that the net lacks are ignored. Of layers that the file lacks a warning
        tells, and they keep the weights they have.

        Raises:
            OSError: the file cannot be read.
            revisit.InputError: it is not a weights file, or the weights of a layer do not fit.
        """
        self._weights.copy_from(_engine.WeightsFile(weights))
        self._ranges.clear()

    def share_with(self, other):
        """Uses the weights of the layers of `other` that have the same name, from now on both's.

        Raises:
            ValueError: layers of one name have weights of different shapes.
        """
        self._weights.share_with(other._weights)

    def _update_weights(self):
        if self._weights.update():
            self._ranges.clear()

    def save(self, path):
        """Writes a caffemodel of all layers and weights, which appears whole or not at all.

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
        chunks = _caffemodel.caffemodel(self._name, layers)
        try:
            write_atomically(os.fsdecode(path), chunks)
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

    load_hdf5 = copy_from  # which reads HDF5 files, too

    # -- Names.

    @property
    def params(self):
        """The weights: lists of blobs by name of layer, of the layers that have some."""
        return OrderedDict((layer.name, layer.blobs) for layer in self.layers if layer.blobs)

    @property
    def layer_dict(self):
        """The layers by name."""
        return OrderedDict(zip(self._layer_names, self.layers))

    @property
    def top_names(self):
        """The blobs that each layer writes."""
        return OrderedDict((layer.name, layer.tops) for layer in self.layers)

    @property
    def bottom_names(self):
        """The blobs that each layer reads."""
        return OrderedDict((layer.name, layer.bottoms) for layer in self.layers)

    @property
    def blob_loss_weights(self):
        """The weight of each blob in the loss, which only training needs: 0."""
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

    # -- Running.

    def _shapes(self, range_):
        return {blob: tuple(self.blobs[blob].shape) for blob in range_.inputs}

    def _take_shapes(self, range_):
        for blob, shape in range_.plan(self._shapes(range_)).shapes().items():
            self.blobs[blob].become(shape)

    def reshape(self):
        """Gives all blobs the shapes that follow from those of the inputs."""
        self._update_weights()
        for step in _structure.steps(self.layers, 0, len(self.layers) - 1):
            if isinstance(step, _structure.Layer):
                step.script.reshape(*self._blobs_of(step))
                continue
            range_ = self._ranges.get(*step)
            if range_ is not None:
                self._take_shapes(range_)

    def _forward(self, first, last):
        """Runs layers first to last, inclusive. Returns the loss, 0: it is for training."""
        if self._phase == caffe_pb2.TRAIN:
            raise TrainingError('forward() of a net in the phase caffe.TRAIN')
        self._update_weights()
        if first == 0 and self._batches is not None:
            self._take_batch()
        for step in _structure.steps(self.layers, first, last):
            if isinstance(step, _structure.Layer):
                blobs = self._blobs_of(step)
                step.script.reshape(*blobs)
                step.script.forward(*blobs)
                continue
            range_ = self._ranges.get(*step)
            if range_ is not None:
                self._run(range_)
        return 0.0

    def _run(self, range_):
        values = {blob: self.blobs[blob].read() for blob in range_.inputs}
        written = range_.plan(self._shapes(range_)).forward(values)
        for blob, array in written.items():
            if array.size == 0 and blob in self._detectors:
                array = _no_detections(self.blobs[self._detectors[blob]].shape[0])
            self.blobs[blob].take(array)

    def _index(self, layer):
        if layer not in self._layer_names:
            raise ValueError(f"the net has no layer '{layer}'; its layers are {', '.join(self._layer_names)}")
        return self._layer_names.index(layer)

    def forward(self, blobs=None, start=None, end=None, **inputs):
        """Runs the net, or the layers from `start` to `end`.

        Args:
            blobs: names of blobs to return beside the outputs.
            start, end: names of layers, inclusive. What they read is taken from the blobs as they are.
            inputs: arrays by name of input; all of them, or none to use what the input blobs hold.
        Returns:
            The arrays of the net's outputs (or what `end` writes), by name: the memory of the blobs, which the next
            pass overwrites.
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
        """Runs the net on any number of images, batch after batch.

        Args:
            blobs: names of blobs to return beside the outputs.
            inputs: arrays or lists of the images of each input, by name.
        Returns:
            Arrays with a row for each image, by name of blob. They are copies.
        """
        if not inputs:
            raise ValueError(f'expected arrays for the inputs {sorted(self.inputs)}, found none')
        n_images = len(next(iter(inputs.values())))
        n_padding = -n_images % next(iter(self.blobs.values())).shape[0]
        collected = {name: [] for name in dict.fromkeys([*self.outputs, *(blobs or ())])}
        for batch in self._batch(inputs):
            for name, values in self.forward(blobs=blobs, **batch).items():
                collected[name].extend(values.copy())
        n_rows = max(1, n_images + n_padding)  # of no images no batch
        return {name: np.asarray(rows[: len(rows) * n_images // n_rows]) for name, rows in collected.items()}

    def _batch(self, inputs):
        """The inputs cut into batches; the last is filled up with zeros."""
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
        """Gives a MemoryData layer, which is an input here, its images: each forward() takes the next batch.

        After the last batch comes the first again. forward() with arrays of its own ends that.

        Args:
            data: [n][c][h][w], n a multiple of the batch size that the layer has.
            labels: [n][1][1][1], or [n]; not looked at where nothing in the net reads labels.
        Raises:
            ValueError: arrays that do not fit the layer.
        """
        if self.layers[0].type != 'Input':
            raise ValueError('set_input_arrays() is for nets whose first layer is a MemoryData layer')
        data, labels = np.asarray(data, np.float32), np.asarray(labels, np.float32)
        size, *image = self.blobs[self.inputs[0]].shape
        if list(data.shape[1:]) != image or len(data) == 0 or len(data) % size:
            raise ValueError(
                f"input '{self.inputs[0]}': expected images of {image}, as many as a multiple of the batch size "
                f'{size}, found {list(data.shape)}'
            )
        if labels.size != len(data):
            raise ValueError(f'expected {len(data)} labels, one for each image, found {labels.size}')
        self._batches = itertools.cycle(range(0, len(data), size))
        self._images = [data, labels.reshape(-1)][: len(self.inputs)]

    def _take_batch(self):
        begin = next(self._batches)
        for name, array in zip(self.inputs, self._images):
            blob = self.blobs[name]
            blob.data[...] = array[begin : begin + blob.shape[0]].reshape(blob.shape)

    # -- Training.

    def backward(self, diffs=None, start=None, end=None, **gradients):
        """For training: raises TrainingError."""
        raise TrainingError('Net.backward()')

    _backward = backward

    def forward_backward_all(self, blobs=None, diffs=None, **inputs):
        """For training: raises TrainingError."""
        raise TrainingError('Net.forward_backward_all()')

    def clear_param_diffs(self):
        """Sets the gradients of all weights to zero, which they are unless a script wrote to them."""
        for layer in self.layers:
            for blob in layer.blobs:
                blob.diff[...] = 0

