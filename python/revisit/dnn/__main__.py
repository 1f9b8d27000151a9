"""Runs a script with Caffe networks in cv2.dnn: python -m revisit.dnn SCRIPT [ARGUMENTS]."""

import os
import runpy
import sys

from revisit import dnn


def main():
    if len(sys.argv) < 2 or sys.argv[1].startswith('-'):
        sys.exit('usage: python -m revisit.dnn SCRIPT [ARGUMENTS]')
    del sys.argv[0]
    sys.path[0] = os.path.dirname(os.path.realpath(sys.argv[0]))
    dnn.install()
    runpy.run_path(sys.argv[0], run_name='__main__')


if __name__ == '__main__':
    main()
