"""Tests the wheel of the engine in an environment with only numpy: revisit.dnn classifies, is quick, and is self-contained."""

import subprocess
import sys
from pathlib import Path

import numpy as np

SECONDS = 0.3  # at most, for import revisit.dnn after numpy
NET = b"""
input: "data" input_shape { dim: 1 dim: 3 dim: 4 dim: 4 }
layer { name: "fc" type: "InnerProduct" bottom: "data" top: "fc" inner_product_param { num_output: 3 } }
layer { name: "prob" type: "Softmax" bottom: "fc" top: "prob" }
"""


def classifies():
    from revisit import dnn, proto
    weights = np.zeros((3, 48), np.float32)
    weights[1] = 1
    file = proto.parse_net(NET.decode())
    file.set_weights({'fc': [weights, np.zeros(3, np.float32)]})
    net = dnn.readNetFromCaffe(NET, file.to_bytes())
    net.setInput(dnn.blobFromImage(np.full((9, 7, 3), 9, np.uint8), 1, (4, 4)))
    assert net.forward().argmax() == 1, net.forward()


def imports_quickly():
    code = 'import time; a = time.perf_counter(); import numpy; b = time.perf_counter(); import revisit.dnn; print(b - a, time.perf_counter() - b)'
    done = [subprocess.run([sys.executable, '-I', '-c', code], check=True, capture_output=True, text=True).stdout.split() for _ in range(5)]
    of_numpy, own = (min(float(times[i]) for times in done) for i in (0, 1))
    print(f'import revisit.dnn: {own:.2f} s, numpy {of_numpy:.2f} s')
    assert own < SECONDS, done


def needs_only_numpy():
    import revisit
    from wheel_check_common import stands_alone
    assert not hasattr(revisit, 'maps') and 'google.protobuf' not in sys.modules
    stands_alone()
    try:
        import revisit.caffe
        assert False, revisit.caffe
    except ImportError as error:
        assert "'caffe': pip install protobuf" in str(error), error


sys.path.insert(0, str(Path(__file__).parent))
classifies()
imports_quickly()
needs_only_numpy()
print('the engine works')
