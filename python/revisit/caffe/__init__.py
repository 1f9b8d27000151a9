"""Drop-in replacement for pycaffe: `import revisit.caffe as caffe`.

Scripts that run networks work unchanged. Functions for training raise TrainingError. docs/PYTHON.md lists the differences.
"""

import sys as _sys
import time as _time
import warnings as _warnings

try:
    import google.protobuf as _protobuf
except ImportError as _error:
    raise ImportError("revisit.caffe needs the packages of the extra 'caffe': pip install protobuf pillow") from _error

from ..engine import layer_types as _layer_types
from . import _caffe, coord_map, io, net_spec, proto
from ._blob import Blob
from ._engine import set_allow_unknown, set_threads
from ._caffe import Layer, Net, TrainingError
from ._weights import set_random_seed
from .classifier import Classifier, Detector
from .net_spec import NetSpec, layers, params, to_proto
from .proto.caffe_pb2 import TEST, TRAIN

__all__ = ['Blob', 'Classifier', 'Detector', 'Layer', 'Net', 'NetSpec', 'TEST', 'TRAIN', 'Timer', 'TrainingError', 'coord_map', 'has_nccl',
           'init_log', 'io', 'layer_type_list', 'layers', 'log', 'net_spec', 'params', 'proto', 'set_allow_unknown', 'set_device',
           'set_mode_cpu', 'set_mode_gpu', 'set_random_seed', 'set_threads', 'to_proto']
__version__ = '1.0.0'  # version of the pycaffe interface


def set_mode_cpu():
    """Does nothing, because nets run on the CPU."""


_has_warned_of_gpu = False


def set_mode_gpu():
    """Warns at the first call that nets run on the CPU."""
    global _has_warned_of_gpu
    if not _has_warned_of_gpu:
        _has_warned_of_gpu = True
        _warnings.warn('this caffe runs on the CPU: set_mode_gpu() and set_device() do nothing', stacklevel=2)


def set_device(device):
    """Same as set_mode_gpu()."""
    set_mode_gpu()


def layer_type_list():
    """Returns the supported layer types, sorted. Layers that read training data become inputs."""
    reading = ['Data', 'HDF5Data', 'ImageData', 'MemoryData', 'WindowData']
    return sorted([*_layer_types(), 'Input', 'Python', *reading])


def has_nccl():
    """Returns False: there is no training on several GPUs."""
    return False


def init_log(level=0, stderr=True):
    """Does nothing, because nothing is logged."""


def log(message):
    """Prints a message to the standard error output."""
    print(message, file=_sys.stderr)


class Timer:
    """Stopwatch: start(), stop(), then read ms."""

    def __init__(self):
        self.ms = 0.0

    def start(self):
        """Begins to measure."""
        self._begin = _time.perf_counter()

    def stop(self):
        """Sets ms to the time since start()."""
        self.ms = (_time.perf_counter() - self._begin) * 1e3


def _solver(name):
    def refuse(*arguments, **options):
        raise TrainingError(f'caffe.{name}')

    refuse.__name__ = refuse.__qualname__ = name
    refuse.__doc__ = 'Raises TrainingError.'
    return refuse


for _name in (
    'SGDSolver NesterovSolver AdaGradSolver RMSPropSolver AdaDeltaSolver AdamSolver get_solver NCCL '
    'solver_count set_solver_count solver_rank set_solver_rank set_multiprocess'
).split():
    globals()[_name] = _solver(_name)
    __all__.append(_name)
