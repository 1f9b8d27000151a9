"""Runs a script with `import caffe` unchanged: python -m revisit.caffe [--allow-unknown] SCRIPT [ARGUMENTS]."""

import os
import runpy
import sys

from revisit import caffe
from revisit.caffe import classifier


def _register_as_caffe():
    modules = {
        'caffe': caffe,
        'caffe._caffe': caffe._caffe,
        'caffe.io': caffe.io,
        'caffe.classifier': classifier,
        'caffe.coord_map': caffe.coord_map,
        'caffe.detector': classifier,
        'caffe.net_spec': caffe.net_spec,
        'caffe.proto': caffe.proto,
        'caffe.proto.caffe_pb2': caffe.proto.caffe_pb2,
    }
    sys.modules.update(modules)


def main():
    if sys.argv[1:2] == ['--allow-unknown']:
        del sys.argv[1]
        caffe.set_allow_unknown(True)
    if len(sys.argv) < 2 or sys.argv[1].startswith('-'):
        sys.exit('usage: python -m revisit.caffe [--allow-unknown] SCRIPT [ARGUMENTS]')
    del sys.argv[0]
    sys.path[0] = os.path.dirname(os.path.realpath(sys.argv[0]))
    _register_as_caffe()
    runpy.run_path(sys.argv[0], run_name='__main__')


if __name__ == '__main__':
    main()
