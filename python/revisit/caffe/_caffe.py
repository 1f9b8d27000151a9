"""The types that scripts name as caffe._caffe.BlobVec and the like."""

from ._blob import Blob, BlobVec
from ._net import Net
from ._scripts import Layer
