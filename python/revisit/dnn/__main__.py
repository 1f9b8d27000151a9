"""Runs a script with Caffe networks in cv2.dnn: python -m revisit.dnn SCRIPT [ARGUMENTS]."""

from revisit import dnn
from revisit._shared import run_script

if __name__ == '__main__':
    dnn.install()
    run_script('usage: python -m revisit.dnn SCRIPT [ARGUMENTS]')
