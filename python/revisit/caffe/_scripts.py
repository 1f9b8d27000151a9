"""Layers that run in Python: those of scripts, and DummyData."""

import importlib

from ..errors import InputError
from . import _weights
from ._blob import BlobVec


class _Phase(int):
    """caffe.TRAIN or caffe.TEST. str() gives the name, as in the fork of Faster R-CNN; in Caffe, the number."""

    def __str__(self):
        return 'TEST' if self else 'TRAIN'


class Layer:
    """Base class of layers written in Python.

    Subclasses define setup(bottom, top), reshape(bottom, top) and forward(bottom, top), where `bottom` and `top` are lists of
    blobs. backward() is never called.

    Attributes:
        param_str: parameter text of the layer in the prototxt.
        phase: caffe.TEST or caffe.TRAIN; str(phase) is 'TEST' or 'TRAIN'.
        blobs: weights that the layer may add; they are never loaded from files.
    """

    def __init__(self, param):
        self.param_str = self.param_str_ = param.python_param.param_str
        self.phase = _Phase(param.phase)
        self.blobs = BlobVec()

    def setup(self, bottom, top):
        """Called once, before reshape()."""

    def reshape(self, bottom, top):
        """Sets the shapes of `top`; called before each forward()."""

    def forward(self, bottom, top):
        """Writes `top`."""
        raise NotImplementedError(f'{type(self).__name__} does not define forward(bottom, top)')


class DummyData(Layer):
    """Constants, filled once, and random numbers, drawn in every pass."""

    def __init__(self, param):
        super().__init__(param)
        self._n_tops = len(param.top)
        dummy = param.dummy_data_param
        self._fillers = self._for_each(list(dummy.data_filler) or [None], 'data_filler')
        if dummy.shape:
            self._shapes = [tuple(shape.dim) for shape in self._for_each(dummy.shape, 'shape')]
        else:
            axes = (self._for_each(getattr(dummy, name), name) for name in ('num', 'channels', 'height', 'width'))
            self._shapes = list(zip(*axes))

    def _for_each(self, given, name):
        if len(given) not in (1, self._n_tops):
            raise InputError(f'{name}: expected 1 value, or {self._n_tops}, one per output, found {len(given)}')
        return [given[0 if len(given) == 1 else i] for i in range(self._n_tops)]

    def setup(self, bottom, top):
        for blob, shape in zip(top, self._shapes):
            blob.reshape(*shape)
        self._fill(top, constant=True)

    def forward(self, bottom, top):
        self._fill(top, constant=False)

    def _fill(self, top, constant):
        for blob, filler in zip(top, self._fillers):
            if filler is not None and (filler.type == 'constant') == constant:
                blob.data[...] = _weights.fill(filler, blob.shape)


def make(message, prototxt):
    """Creates the object of a layer whose type is in IN_PYTHON; imports the module of type Python.

    Raises InputError for a missing module or class or invalid parameters.
    """
    if message.type == 'DummyData':
        try:
            return DummyData(message)
        except InputError as error:
            raise InputError(f"{prototxt}: layer '{message.name}' (DummyData): {error}") from None
    return _make_script(message, prototxt)


def _make_script(message, prototxt):
    where = f"{prototxt}: layer '{message.name}' (Python)"
    param = message.python_param
    try:
        module = importlib.import_module(param.module)
    except ModuleNotFoundError as error:
        raise InputError(f"{where}: {error}; add its folder to PYTHONPATH") from error
    kind = getattr(module, param.layer, None)
    if not (isinstance(kind, type) and issubclass(kind, Layer)):
        raise InputError(f"{where}: expected a class '{param.layer}' derived from caffe.Layer in {module.__file__}")
    return kind(message)
