#!/usr/bin/env python3
"""Times one network in revisit, ONNX Runtime and OpenVINO, alternating; prints JSON.

  peers.py REVISIT NET.prototxt NET.caffemodel NET.onnx --threads 2 --repeat 20

compare.py runs it with a Python that has onnxruntime and openvino. Missing packages are skipped.
"""

import argparse
import json
import statistics
import subprocess
import sys
import time

import numpy as np

ROUNDS = 4


def revisit(options, precision):
    command = [options.revisit, 'net', 'profile', options.prototxt, options.weights, '--threads',
               str(options.threads), '--repeat', str(options.repeat), '--precision', precision,
               '--format', 'json']

    def measure():
        result = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True)
        total = json.loads(result.stdout)['total_ms']
        return total['min'], total['median']
    return measure


def in_process(run, repeat):
    def measure():
        times = []
        for _ in range(repeat + 3):
            start = time.perf_counter()
            run()
            times.append(1e3 * (time.perf_counter() - start))
        return min(times[3:]), statistics.median(times[3:])  # the first three are warm-up
    return measure


def onnx_runtime(options):
    import onnxruntime
    session_options = onnxruntime.SessionOptions()
    session_options.intra_op_num_threads = options.threads
    session_options.inter_op_num_threads = 1
    session_options.log_severity_level = 3
    session = onnxruntime.InferenceSession(options.onnx, session_options,
                                           providers=['CPUExecutionProvider'])
    port = session.get_inputs()[0]
    image = np.random.default_rng(1).standard_normal(port.shape).astype(np.float32) * 50
    return f'ONNX Runtime {onnxruntime.__version__}', in_process(
        lambda: session.run(None, {port.name: image}), options.repeat)


def openvino(options, precision):
    import openvino as ov
    model = ov.Core().compile_model(options.onnx, 'CPU', {
        'INFERENCE_NUM_THREADS': options.threads, 'NUM_STREAMS': 1,
        'INFERENCE_PRECISION_HINT': precision, 'PERFORMANCE_HINT': 'LATENCY'})
    shape = list(model.input(0).shape)
    image = np.random.default_rng(1).standard_normal(shape).astype(np.float32) * 50
    request = model.create_infer_request()
    return f'OpenVINO {ov.__version__.split("-")[0]}', in_process(
        lambda: request.infer({0: image}), options.repeat)


def main():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    for name in ('revisit', 'prototxt', 'weights', 'onnx'):
        parser.add_argument(name)
    parser.add_argument('--threads', type=int, default=1)
    parser.add_argument('--repeat', type=int, default=20)
    options = parser.parse_args()
    engines = [('revisit', 'float32', revisit(options, 'float32')),
               ('revisit', 'bf16', revisit(options, 'bf16'))]
    try:
        name, measure = onnx_runtime(options)
        engines.append((name, 'float32', measure))
    except ImportError as error:
        print(error, file=sys.stderr)
    try:
        for precision, hint in (('float32', 'f32'), ('bf16', 'bf16')):
            name, measure = openvino(options, hint)
            engines.append((name, precision, measure))
    except ImportError as error:
        print(error, file=sys.stderr)
    times = {i: [] for i in range(len(engines))}
    for _ in range(ROUNDS):
        for i, (_, _, measure) in enumerate(engines):
            times[i].append(measure())
            time.sleep(0.05)
    print(json.dumps([{'engine': name, 'precision': precision,
                       'min_ms': min(t[0] for t in times[i]),
                       'median_ms': statistics.median(t[1] for t in times[i])}
                      for i, (name, precision, _) in enumerate(engines)]))


if __name__ == '__main__':
    main()
