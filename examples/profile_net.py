#!/usr/bin/env python3
"""Profiles a Caffe network by layer.

  profile_net.py deploy.prototxt --shape 1,3,107,4000 --end conv3 -o bars.png
"""

import argparse

import numpy as np

import revisit
from revisit.engine import Net, profile


def draw(file, costs, times):
    import matplotlib
    matplotlib.use('Agg')
    from matplotlib import pyplot
    ran = [(cost.name, time.median) for cost, time in zip(costs, times) if time.median > 0]
    figure, axes = pyplot.subplots(figsize=(7, 0.3 * len(ran) + 1), layout='constrained')
    axes.barh([name for name, _ in ran], [ms for _, ms in ran])
    axes.invert_yaxis()
    axes.set_xlabel('median [ms]')
    figure.savefig(file)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('prototxt')
    parser.add_argument('weights', nargs='?', help='weights file (default: random weights, which take the same time)')
    parser.add_argument('--end', default='', help='truncate the network after this layer')
    parser.add_argument('--shape', help='input shape, e.g. 1,3,107,4000')
    parser.add_argument('--threads', type=int, default=1)
    parser.add_argument('--repeat', type=int, default=20)
    parser.add_argument('-o', '--output', help='bar chart to write (needs matplotlib)')
    o = parser.parse_args()

    inputs = {}
    if o.shape:
        name = revisit.engine.input_blobs(o.prototxt)[0]
        inputs[name] = tuple(int(size) for size in o.shape.split(','))
    if o.weights:
        net = Net.load(o.prototxt, o.weights, end=o.end, inputs=inputs)
    else:
        net = Net.load_with_random_weights(o.prototxt, 1, end=o.end, inputs=inputs)

    run = net.plan(threads=o.threads).run()
    for name, shape in net.inputs.items():
        run.set_input(name, np.random.default_rng(1).uniform(0, 255, shape).astype(np.float32))
    times = profile(run, repeat=o.repeat)

    costs = run.plan.layers
    print(f'{"layer":24} {"kernel":24} {"MMACs":>9} {"ms":>8} {"GMAC/s":>8}')
    for cost, time in zip(costs, times.layers):
        speed = f'{cost.macs / time.median / 1e6:8.1f}' if cost.macs and time.median else ''
        print(f'{cost.name[:24]:24} {cost.kernel[:24]:24} {cost.macs / 1e6:9.1f} {time.median:8.3f} {speed}')
    print(f'{"total":24} {"":24} {sum(cost.macs for cost in costs) / 1e6:9.1f} {times.total.median:8.3f}')
    print(f'{run.plan.arena_bytes / 2**20:.1f} MiB per run, {run.plan.weight_bytes / 2**20:.1f} MiB of weights')
    if o.output:
        draw(o.output, costs, times.layers)


if __name__ == '__main__':
    try:
        main()
    except revisit.Error as error:
        raise SystemExit(f'profile_net: {error}')
