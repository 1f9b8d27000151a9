"""Original Caffe networks on the CPU, and place recognition from LiDAR scans."""

from revisit import errors  # before _core, which raises them
from revisit._core import __version__
from revisit import engine, proto
from revisit.errors import (
    Error, InputError, Interrupted, MemoryError, UnsupportedError, UsageError)

__all__ = [
    'Error', 'InputError', 'Interrupted', 'MemoryError', 'UnsupportedError', 'UsageError',
    '__version__', 'engine', 'errors', 'proto']
