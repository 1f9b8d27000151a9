"""Times one network in revisit, ONNX Runtime and OpenVINO, alternating. Missing packages are skipped."""

import statistics
import sys
import time

import numpy as np

ROUNDS = 4


def in_process(run, repeat):
    def measure():
        times = []
        for _ in range(repeat + 3):
            start = time.perf_counter()
            run()
            times.append(1e3 * (time.perf_counter() - start))
        return min(times[3:]), statistics.median(times[3:])  # the first three are warm-up
    return measure


def image_of(shape):
    return np.random.default_rng(1).standard_normal(list(shape)).astype(np.float32) * 50


def onnx_runtime(onnx, threads, repeat):
    import onnxruntime
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads, options.inter_op_num_threads, options.log_severity_level = threads, 1, 3
    session = onnxruntime.InferenceSession(onnx, options, providers=['CPUExecutionProvider'])
    port = session.get_inputs()[0]
    image = image_of(port.shape)
    yield f'ONNX Runtime {onnxruntime.__version__}', 'float32', in_process(lambda: session.run(None, {port.name: image}), repeat)


def openvino(onnx, threads, repeat):
    import openvino as ov
    for precision, hint in (('float32', 'f32'), ('bf16', 'bf16')):
        model = ov.Core().compile_model(onnx, 'CPU', {'INFERENCE_NUM_THREADS': threads, 'NUM_STREAMS': 1,
                                                      'INFERENCE_PRECISION_HINT': hint, 'PERFORMANCE_HINT': 'LATENCY'})
        image, request = image_of(model.input(0).shape), model.create_infer_request()
        yield (f'OpenVINO {ov.__version__.split("-")[0]}', precision,
               in_process(lambda image=image, request=request: request.infer({0: image}), repeat))


def compared(profile, onnx, threads, repeat):
    """Times of each engine [ms]. profile(precision): of revisit, the fastest pass and the median."""
    engines = [('revisit', precision, lambda precision=precision: profile(precision)) for precision in ('float32', 'bf16')]
    for peer in (onnx_runtime, openvino):
        try:
            engines += peer(str(onnx), threads, repeat)
        except ImportError as error:
            print(error, file=sys.stderr)
    times = [[] for _ in engines]
    for _ in range(ROUNDS):
        for found, (_, _, measure) in zip(times, engines):
            found.append(measure())
            time.sleep(0.05)
    return [{'engine': name, 'precision': precision, 'min_ms': min(t[0] for t in found), 'median_ms': statistics.median(t[1] for t in found)}
            for found, (name, precision, _) in zip(times, engines)]
