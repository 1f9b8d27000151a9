#!/usr/bin/env python3
"""Builds and runs the benchmarks. Prints tables in Markdown and writes JSON.

  bench/compare.py engines               revisit, im2col + OpenBLAS, oneDNN and OpenCV in one run
  bench/compare.py threads               utilization of 8 and 16 threads, simulated from the pieces of work
  bench/compare.py peers                 ONNX Runtime and OpenVINO, float32 and bf16

Needs only Python's standard library and the packages of tools/bench_packages.txt. `peers` needs:
  python3 -m venv peers && peers/bin/pip install . onnx onnxruntime openvino && peers/bin/python bench/compare.py peers
"""

import argparse
import json
import os
import platform
import re
import subprocess
import sys
from pathlib import Path

from nets import NETS
from tables import markdown

ROOT = Path(__file__).resolve().parents[1]
RANGE_IMAGE = (107, 4000)
# Net, height, width, whether the engines may exploit equal input channels.
CASES = [('alexnet', *RANGE_IMAGE, True), ('vgg_cnn_s', *RANGE_IMAGE, True), ('places_cnds8', *RANGE_IMAGE, True),
         ('alexnet', 112, 4000, True), ('alexnet', 227, 227, False), ('squeezenet', 227, 227, False), ('squeezenet', 112, 4000, True),
         ('vgg16', 224, 224, False), ('vgg16', 112, 4000, True), ('resnet50', 224, 224, False), ('resnet50', 112, 4000, True)]
PAPER_CASES = CASES[:3]
# Net, channels (1: replicated single channel of a range image), height, width.
PEER_CASES = [('alexnet', 1, *RANGE_IMAGE), ('vgg_cnn_s', 1, *RANGE_IMAGE), ('places_cnds8', 1, *RANGE_IMAGE),
              ('whole_alexnet', 3, 227, 227), ('whole_vgg16', 3, 224, 224), ('googlenet', 3, 224, 224), ('whole_squeezenet', 3, 227, 227),
              ('mobilenet_v1', 3, 224, 224), ('mobilenet_v2', 3, 224, 224), ('resnet50', 3, 224, 224)]
BUSY_THREADS = (2, 8, 16)
NOTES = {('opencv', 'vgg_cnn_s'): "wrong result: OpenCV's importer of Caffe nets ignores k of LRN"}


def run(command, **options):
    return subprocess.run([str(part) for part in command], check=True, text=True, cwd=ROOT, **options)


def output_of(command):
    # Removes variables that may select slower kernels.
    environment = {k: v for k, v in os.environ.items() if k not in ('OPENBLAS_CORETYPE', 'OPENBLAS_L2_SIZE', 'OMP_NUM_THREADS')}
    return json.loads(run(command, stdout=subprocess.PIPE, env=environment).stdout)


class Programs:
    """Programs to measure, built in `build`; prototxts and weights of nets are written to `folder`."""

    def __init__(self, build, folder, jobs):
        self.build, self.folder = build, folder
        # With the pipeline, because `revisit models make-random` needs it.
        run(['cmake', '-S', ROOT, '-B', build, '-G', 'Ninja', '-DREVISIT_BENCH=ON', '-DCMAKE_BUILD_TYPE=Release'],
            stdout=subprocess.DEVNULL)
        run(['cmake', '--build', build, '-j', jobs, '--target', 'revisit', 'revisit_compare',
             'revisit_busy_threads'], stdout=subprocess.DEVNULL)

    def bench(self, name):
        return self.build / 'tests' / 'bench' / name

    def prototxt(self, name, batch, channels, height, width):
        self.folder.mkdir(parents=True, exist_ok=True)
        path = self.folder / f'{name}_{batch}x{channels}x{height}x{width}.prototxt'
        path.write_text(NETS[name](batch, channels, height, width))
        return path

    def net(self, name, batch, height, width, channels=3):
        """Returns a prototxt and random weights, which include all layers at 224 x 224 and are equal for every size."""
        prototxt = self.prototxt(name, batch, channels, height, width)
        whole_size = max(224, min(height, width))  # inner products have a fixed size
        weights = self.folder / f'{name}_{channels}.caffemodel'
        if not weights.exists():
            whole = self.folder / f'{name}_{channels}.prototxt'
            whole.write_text(NETS[name](1, channels, whole_size, whole_size))
            run([self.build / 'tools' / 'revisit', 'models', 'make-random', '--net', whole, '-o', self.folder], stdout=subprocess.DEVNULL)
            (self.folder / f'{whole.stem}_random.caffemodel').rename(weights)
        return prototxt, weights

    def peers(self, case, threads, options):
        import peers  # needs numpy
        name, channels, height, width = case
        prototxt, weights = self.net(name, 1, height, width, channels)
        revisit, onnx = self.build / 'tools' / 'revisit', prototxt.with_suffix('.onnx')
        if not onnx.exists():
            run([sys.executable, '-m', 'revisit.conversion', 'onnx', prototxt, weights, onnx, '--fixed', '--no-check'], stdout=subprocess.DEVNULL)

        def profile(precision):
            total = output_of([revisit, 'net', 'profile', prototxt, weights, '--threads', threads, '--repeat', options.repeat,
                               '--precision', precision, '--format', 'json'])['total_ms']
            return total['min'], total['median']
        return {'input': [1, *case[1:]], 'threads': threads, 'engines': peers.compared(profile, onnx, threads, options.repeat)}

    def engines(self, case, threads, options):
        net, height, width, gray = case
        return output_of([self.bench('revisit_compare'), *self.net(net, 1, height, width), '--threads', threads, '--repeat', options.repeat,
                          *options.engines, *['--gray'] * gray])

    def threads(self, case, threads, options):
        name, channels, height, width = case
        return output_of([self.bench('revisit_busy_threads'), self.prototxt(name, 1, 3, height, width), threads, *['gray'] * (channels == 1)])


def engines_table(results):
    rows = []
    for result in results:
        ours = result['engines'][0]
        for engine in result['engines']:
            times = [f"{engine['min_ms']:.2f}", f"{engine['median_ms']:.2f}", f"{engine['cpu_ms']:.2f}", f"{engine['steps_ms']:.2f}"]
            ratios = [f"{engine[key] / ours[key]:.2f}" for key in ('min_ms', 'median_ms', 'cpu_ms')]
            note = NOTES.get((engine['engine'], result['net']), '')
            rows.append([result['net'], 'x'.join(map(str, result['input'])), str(result['threads']),
                         engine['name'], *times, *ratios, f"{engine['max_difference']:.1e}",
                         f"{engine['rms_difference']:.1e}", note])
    return markdown(['net', 'input', 'threads', 'engine', 'min ms', 'median ms', 'min CPU ms',
                  'sum of layer minima', 'min / ours', 'median / ours', 'CPU / ours', 'max diff',
                  'rms diff', 'note'], rows)


def peers_table(results):
    rows = []
    for result in results:
        ours = {e['precision']: e for e in result['engines'] if e['engine'] == 'revisit'}
        for engine in result['engines']:
            ratios = [f"{engine[key] / ours[engine['precision']][key]:.2f}" for key in ('min_ms', 'median_ms')]
            rows.append([result['net'], 'x'.join(map(str, result['input'])), str(result['threads']),
                         engine['engine'], engine['precision'], f"{engine['min_ms']:.2f}",
                         f"{engine['median_ms']:.2f}", *ratios])
    return markdown(['net', 'input', 'threads', 'engine', 'precision', 'min ms', 'median ms', 'min / ours', 'median / ours'], rows)


def threads_table(results):
    rows = []
    for result in results:
        loss = result['loss']
        rows.append([result['net'], f"{result['threads']}", f"{result['one_thread_ms']:.2f}",
                     f"{result['scheduled_ms']:.2f}", f"{result['one_thread_ms'] / result['scheduled_ms']:.1f}",
                     f"{100 * result['scarce_share']:.1f}", f"{100 * result['serial_share']:.1f}",
                     f"{loss['layer']} ({loss['kernel']}), {loss['pieces']} pieces, {loss['lost_ms']:.2f} ms"])
    return markdown(['net', 'threads', 'ms on one', 'ms without memory limit', 'speedup',
                  '% in fewer pieces than threads', '% outside of pieces', 'largest loss'], rows)


def measured(options):
    programs, results = Programs(options.build, options.build / 'nets', options.jobs), []
    for case in options.cases if options.what == 'engines' else options.peer_cases:
        for threads in BUSY_THREADS if options.what == 'threads' else options.threads:
            results.append({'net': case[0], **getattr(programs, options.what)(case, threads, options)})
            print(f'{case}, {threads} threads: done', file=sys.stderr)
    return results


def machine():
    model = re.search(r'model name\s*:\s*(.*)', Path('/proc/cpuinfo').read_text())
    return {'cpu': model.group(1) if model else platform.processor(), 'cores': os.cpu_count(),
            'load': os.getloadavg()[0], 'system': platform.platform()}


def parse_options():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('what', choices=['engines', 'threads', 'peers'])
    parser.add_argument('-b', '--build', type=Path, default=ROOT / 'build' / 'bench', help='build folder (default: build/bench)')
    parser.add_argument('-o', '--output', type=Path, help='folder for results.json and results.md (default: the build folder)')
    parser.add_argument('--nets', default='', help='regular expression for net and size, e.g. "resnet50 224x224", '
                        'to select from ' + ', '.join(NETS))
    parser.add_argument('--all-sizes', action='store_true', help="every net and input size (default: the paper's three nets)")
    parser.add_argument('--engines', default=[], type=lambda names: names.split(','), help='some of revisit,original,onednn,opencv; revisit first')
    parser.add_argument('--threads', default='1,2', help='default: 1,2')
    parser.add_argument('--repeat', type=int, default=20, help='passes (default: 20)')
    parser.add_argument('-j', '--jobs', type=int, default=os.cpu_count(), help='jobs of the build')
    options = parser.parse_args()
    options.threads = [int(number) for number in options.threads.split(',')]
    options.cases = [case for case in (CASES if options.all_sizes else PAPER_CASES)
                     if re.search(options.nets, f'{case[0]} {case[1]}x{case[2]}')]
    options.peer_cases = [case for case in PEER_CASES if re.search(options.nets, f'{case[0]} {case[2]}x{case[3]}')]
    options.build = options.build.absolute()
    options.output = (options.output or options.build).absolute()
    return options


def main():
    options = parse_options()
    results = measured(options)
    report = {'machine': machine(), options.what: results}
    table_of = {'engines': engines_table, 'peers': peers_table, 'threads': threads_table}[options.what]
    text = '{cpu}, {cores} cores, load {load:.1f}.\n\n'.format(**report['machine']) + '\n'.join(table_of(results)) + '\n'
    options.output.mkdir(parents=True, exist_ok=True)
    (options.output / 'results.json').write_text(json.dumps(report, indent=1))
    (options.output / 'results.md').write_text(text)
    print(text)


if __name__ == '__main__':
    main()
