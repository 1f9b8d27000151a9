"""install(): Caffe networks in an installed cv2.dnn."""

import functools
import importlib

from . import _models, _net


def _is_caffe(arguments):
    """True for the files of a Caffe network, for readNet()'s framework 'caffe', and for a Net of revisit."""
    words = [str(argument).lower() for argument in arguments if isinstance(argument, str) or hasattr(argument, '__fspath__')]
    return any(isinstance(argument, _net.Net) for argument in arguments) or any(
        word == 'caffe' or word.endswith(('.caffemodel', '.prototxt')) for word in words)


def _either(ours, theirs):
    """Returns a function that calls `ours` for Caffe networks, else `theirs`."""
    @functools.wraps(ours, updated=())
    def choose(*arguments, **options):
        return (ours if _is_caffe([*arguments, *options.values()]) else theirs)(*arguments, **options)

    return choose


def install() -> None:
    """Puts readNetFromCaffe into an installed cv2.dnn, and Caffe networks into its readNet() and models.

    Does nothing if cv2.dnn has readNetFromCaffe. Raises ImportError without the package opencv-python.
    """
    cv2 = importlib.import_module('cv2')
    if hasattr(cv2.dnn, 'readNetFromCaffe'):
        return
    cv2.dnn.readNetFromCaffe = _net.readNetFromCaffe
    cv2.dnn.readNet = _either(_net.readNet, cv2.dnn.readNet)
    register, unregister = cv2.dnn_registerLayer, cv2.dnn_unregisterLayer
    cv2.dnn_registerLayer = lambda type, cls: (_net.registerLayer if type == 'Crop' else register)(type, cls)
    cv2.dnn_unregisterLayer = lambda type: None if _net._registered.pop(type, None) else unregister(type)
    for name in ('ClassificationModel', 'DetectionModel', 'KeypointsModel', 'Model', 'SegmentationModel'):
        chosen = _either(getattr(_models, name), getattr(cv2.dnn, name))
        setattr(cv2.dnn, name, chosen)
        setattr(cv2, f'dnn_{name}', chosen)
