"""Layers that scripts bring along: prototxt layers of the type Python."""

import importlib

from ..errors import InputError
from ._blob import BlobVec

TYPE = 'Python'


class Layer:
    """The base of layers written in Python.

    They define setup(bottom, top), reshape(bottom, top) and forward(bottom, top), where `bottom` and
    `top` are lists of blobs. backward() is never called.

    Attributes:
        param_str: the text that the prototxt has for the layer.
        phase: caffe.TEST or caffe.TRAIN.
        blobs: weights that the layer may add; no file gives them.
    """

    def __init__(self, param):
        self.param_str = self.param_str_ = param.python_param.param_str
        self.phase = param.phase
        self.blobs = BlobVec()

    def setup(self, bottom, top):
        """Called once, before reshape()."""

    def reshape(self, bottom, top):
        """Gives `top` its shapes; called before each forward()."""

    def forward(self, bottom, top):
        """Writes `top`."""
        raise NotImplementedError(f'{type(self).__name__} does not define forward(bottom, top)')


def make(message, prototxt):
    """The layer that a LayerParameter of the type Python names; its module is looked for as by `import`.

    Raises:
        revisit.InputError: no such module or class.
    """
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
