"""Loop closure detection for LiDAR SLAM, and original Caffe networks, on the CPU.

Points of a scan are float32 or float64 [n][3 or more], x forward, y left, z up [m], a structured array [n] with such fields x, y, z, or
a tuple of three such arrays. Other types raise TypeError, other shapes ValueError.
"""

from revisit import errors  # before _core, which raises them
from revisit import _core
from revisit import engine, proto  # noqa: E402
from revisit.errors import (  # noqa: E402
    Error, InputError, Interrupted, MemoryError, UnsupportedError, UsageError)

__version__: str = getattr(_core, '__version__')  # which the stubs lack
__all__ = [
    'Error', 'InputError', 'Interrupted', 'MemoryError', 'UnsupportedError', 'UsageError',
    '__version__', 'engine', 'errors', 'proto']

if hasattr(_core, 'maps'):  # builds with REVISIT_PIPELINE=OFF have only the engine
    from revisit import datasets, evaluation, maps, recognition
    from revisit.maps import LoopDetector, Map, open_map

    __all__ += ['LoopDetector', 'Map', 'datasets', 'evaluation', 'maps', 'open_map', 'recognition']
