"""Types that scripts access as caffe._caffe.BlobVec etc."""

from ._blob import Blob, BlobVec
from ._net import Net
from ._scripts import Layer
