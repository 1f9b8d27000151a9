"""Interface to the engine and its number of threads."""

import contextlib
import os

from google.protobuf import text_format

from .. import engine, proto
from ..errors import Error, InputError
from . import _caffemodel
from .proto import caffe_pb2

port_name = engine.port_name
layer_types = engine.layer_types

_threads = None


def threads():
    """Returns the threads of a forward pass: set_threads(), else OMP_NUM_THREADS, else the CPUs of this process."""
    if _threads is not None:
        return _threads
    first = os.environ.get('OMP_NUM_THREADS', '').split(',')[0].strip()
    if first.isdigit() and int(first) > 0:
        return int(first)
    return len(os.sched_getaffinity(0))


def set_threads(number):
    """Sets the number of threads of later forward passes; None: the default. Results do not depend on it."""
    global _threads
    if number is not None and int(number) < 1:
        raise ValueError(f'expected at least one thread, found {number}')
    _threads = None if number is None else int(number)


_allow_unknown = False


def set_allow_unknown(allowed):
    """Allows unknown fields outside layer parameters in prototxts that are read later (default: False)."""
    global _allow_unknown
    _allow_unknown = bool(allowed)


def _meets(state, rule):
    return (
        (not rule.HasField('phase') or rule.phase == state.phase)
        and (not rule.HasField('min_level') or rule.min_level <= state.level)
        and (not rule.HasField('max_level') or rule.max_level >= state.level)
        and set(rule.stage) <= set(state.stage)
        and not set(rule.not_stage) & set(state.stage)
    )


def _included(state, layer):
    if layer.include and layer.exclude:
        raise InputError(f"layer '{layer.name}': expected include or exclude rules, found both")
    if layer.include:
        return any(_meets(state, rule) for rule in layer.include)
    return not any(_meets(state, rule) for rule in layer.exclude)


def _read(prototxt, **options):
    try:
        return proto.read_net(prototxt, allow_unknown_fields=_allow_unknown, keep_python=True, **options)
    except InputError as error:
        words = str(error).replace('NetReadOptions::allow_unknown_fields', 'caffe.set_allow_unknown(True)')
        raise InputError(words) from None


def read_net(prototxt, phase, level, stages):
    """Returns the layers that run, as a NetParameter in the current format, and warnings.

    prototxt: file of any generation; for a solver's file, the net that it names is read.
    phase, level, stages: state for the include and exclude rules of layers, in addition to the file's stages.
    Raises InputError if the file cannot be read or does not parse.
    """
    if phase == caffe_pb2.TEST and level == 0 and not stages:
        file = _read(prototxt)
        return caffe_pb2.NetParameter.FromString(file.to_bytes()), file.warnings
    full = _read(prototxt, keep_training=True)
    net = caffe_pb2.NetParameter.FromString(full.to_bytes())
    net.state.phase, net.state.level = phase, level
    net.state.stage.extend(stages)
    layers = [layer for layer in net.layer if _included(net.state, layer)]
    del net.layer[:]
    for layer in layers:
        layer.ClearField('include')
        layer.ClearField('exclude')
        net.layer.append(layer)
    file = proto.parse_net(text_format.MessageToString(net), prototxt, keep_python=True)
    return caffe_pb2.NetParameter.FromString(file.to_bytes()), full.warnings + file.warnings


class WeightsFile:
    """Bytes of a .caffemodel or HDF5 file, and the names of its layers with weights."""

    def __init__(self, path):
        self.path = os.fspath(path)
        if isinstance(self.path, bytes):
            self.path = os.fsdecode(self.path)
        with open(self.path, 'rb') as file:
            self.content = file.read()
        layers = proto.WeightsFile.from_bytes(self.content, self.path).layers
        self.layers = {name for name, n_arrays in layers if n_arrays > 0}


@contextlib.contextmanager
def named(prototxt, weights="the net's weights"):
    """Inserts file names into messages of the engine, which reads from memory."""
    try:
        yield
    except Error as error:
        message = str(error).replace('<prototxt>', prototxt).replace('<weights>', weights)
        raise type(error)(message) from None


def load(net, weights, prototxt):
    """weights: a WeightsFile, or layer name -> list of arrays. Missing weights become zeros. prototxt: file name for messages.

    Raises InputError if layers and weights do not match, UnsupportedError if the engine lacks a layer type.
    """
    text = text_format.MessageToString(net)
    if isinstance(weights, WeightsFile):
        with named(prototxt, weights.path):
            return engine.Net.load_from_memory(text, weights.content, allow_missing=True)
    with named(prototxt):
        return engine.Net.load_from_memory(text, _caffemodel.in_memory(weights), allow_missing=True)
