"""Names that scripts import from pycaffe's module of this name."""

from ._blob import Blob  # noqa: F401
from ._caffe import Layer, Net  # noqa: F401
from .proto import caffe_pb2  # noqa: F401
