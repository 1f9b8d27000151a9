"""Imports of the tests of revisit.caffe. Exits with a message if a package is missing."""

import os

os.environ.setdefault(
    'OMP_NUM_THREADS', '1'
)  # one thread, because the nets are small

try:
    import google.protobuf  # noqa: F401
except ImportError:
    print('skipped: protobuf for Python is not installed (pip install protobuf)')
    raise SystemExit(0) from None
