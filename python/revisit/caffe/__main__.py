"""Runs a script with `import caffe` unchanged: python -m revisit.caffe [--allow-unknown] SCRIPT [ARGUMENTS]."""

import sys

from revisit import caffe
from revisit._shared import run_script
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
    _register_as_caffe()
    run_script('usage: python -m revisit.caffe [--allow-unknown] SCRIPT [ARGUMENTS]')


if __name__ == '__main__':
    main()
