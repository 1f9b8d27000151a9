"""Layers that run in Python: those that scripts bring along, and DummyData."""

import importlib

from ..errors import InputError
from . import _fillers
from ._blob import BlobVec


class _Phase(int):
    """caffe.TRAIN or caffe.TEST, whose text is its name, as in the fork of Faster R-CNN; in Caffe it is the number's."""

    def __str__(self):
        return 'TEST' if self else 'TRAIN'


class Layer:
    """The base of layers written in Python.

    They define setup(bottom, top), reshape(bottom, top) and forward(bottom, top), where `bottom` and
    `top` are lists of blobs. backward() is never called.

    Attributes:
        param_str: the text that the prototxt has for the layer.
        phase: caffe.TEST or caffe.TRAIN; str(phase) is 'TEST' or 'TRAIN'.
        blobs: weights that the layer may add; no file gives them.
    """

    def __init__(self, param):
        self.param_str = self.param_str_ = param.python_param.param_str
        self.phase = _Phase(param.phase)
        self.blobs = BlobVec()

    def setup(self, bottom, top):
        """Called once, before reshape()."""

    def reshape(self, bottom, top):
        """Gives `top` its shapes; called before each forward()."""

    def forward(self, bottom, top):
        """Writes `top`."""
        raise NotImplementedError(f'{type(self).__name__} does not define forward(bottom, top)')


class DummyData(Layer):
    """Constants, which are filled in once, and random numbers, which are new in every pass."""

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
            raise InputError(
                f'{name} is given {len(given)} times; expected once, or once for each of {self._n_tops} outputs'
            )
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
                blob.data[...] = _fillers.fill(filler, blob.shape)


def make(message, prototxt):
    """The object for a layer of a type in _structure.IN_PYTHON.

    The module of a layer of the type Python is looked for as by `import`.

    Raises:
        revisit.InputError: no such module or class, or parameters that do not fit.
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
        raise InputError(
            f"{where}: {error}; its folder has to be in sys.path (PYTHONPATH, or the script's own)"
        ) from error
    kind = getattr(module, param.layer, None)
    if not (isinstance(kind, type) and issubclass(kind, Layer)):
        raise InputError(
            f"{where}: expected a class '{param.layer}' in {module.__file__} that is derived from caffe.Layer"
        )
    return kind(message)
