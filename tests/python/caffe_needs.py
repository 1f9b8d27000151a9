"""What the tests of revisit.caffe need beside numpy: ends the program, saying so, where it is not there."""

import os

os.environ.setdefault(
    'OMP_NUM_THREADS', '1'
)  # small nets: on a busy machine threads only wait for each other

try:
    import google.protobuf  # noqa: F401
except ImportError:
    print('skipped: protobuf for Python is not installed (pip install protobuf)')
    raise SystemExit(0) from None
