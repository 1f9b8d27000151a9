#!/usr/bin/env python3
"""Evaluates one method on one drive with revisits, causally: every keyframe is a query against earlier ones, then stored.

  real_drives.py DRIVE --method ring [--sensor vlp16] [--no-verify] [--local-map 10]      as in `revisit loops`
  real_drives.py DRIVE --method ring --ring scans.ring --name 'rings without training'
  real_drives.py DRIVE --method scan-context [--ring-keys 10]
  real_drives.py DRIVE --method m2dp
  real_drives.py DRIVE --method cnn --align case1 --sensor hdl32 --model SQUEEZENET
  real_drives.py DRIVE --method learnt --feature scan-context --discriminants towns.npz      (discriminants.py)
  real_drives.py DRIVE --method map-closures --local-map 100          (needs `pip install map-closures kiss-icp`)
  real_drives.py DRIVE --method ring|scan-context --perturb standard                       by `revisit eval`, which is $REVISIT

drives.py defines DRIVE and correct matches. Needs the Python package of revisit. Prints the metrics. --json FILE adds them to
FILE with version, commit, machine and command, and replaces earlier ones of this drive and name.
"""

import argparse
import fcntl
import json
import os
import platform
import re
import shlex
import subprocess
import sys
from pathlib import Path

import numpy as np
from drives import NEGATIVE_RADIUS, RADIUS, RECENT, TwoLaps, figures, open_drive

ROOT = Path(__file__).resolve().parents[1]


def by_detector(drive, map_, verify):
    """Answers as in `revisit loops`, with registration if `verify`, and default acceptance."""
    from revisit import LoopDetector, datasets
    answers, row, detector = [], {}, None
    for i, file in enumerate(drive.files):
        if i in drive.starts:
            exclusion = 'meters=50' if drive.poses is not None else f'frames={len(drive.files)}'  # excludes its own lap
            detector = LoopDetector(map_, drive=f'lap {i}', exclusion=exclusion, verify=verify)
        found = detector.take(datasets.read_scan(file), frame=i, pose=None if drive.poses is None else drive.poses[i])
        if drive.candidates[i] > 0:
            loop = found.loop
            known = detector.threshold is not None
            answers.append((i, row[loop.index], loop.score, found.accepted if known else None) if loop else (i, None, 0, None))
        if found.index is not None:
            row[found.index] = i
    return answers


def principal_components(values, count):
    """Returns the principal components [n][count] of the rows of `values`, by their n x n Gram matrix, for very wide `values`."""
    n, products = len(values), 0
    for first in range(0, values.shape[1], 16384):
        block = values[:, first:first + 16384].astype(np.float32)
        block -= block.mean(0)
        products = products + block @ block.T
    spread, rows = np.linalg.eigh(products.astype(float))
    return (rows * np.sqrt(np.maximum(spread, 0)))[:, ::-1][:, :min(count, n - 1)]


def by_network(drive, o):
    """Answers by the paper's feature with 400 principal components. These are fit on all scans of the drive, which is not causal."""
    from revisit import datasets, engine, recognition
    geometry = recognition.sensor_geometry(o.sensor)
    net = engine.Net.load(o.model / 'deploy.prototxt', o.model / 'weights.caffemodel', end='pool8',
                          inputs={'data': (1, 3, geometry.height, geometry.width)})
    extractor = recognition.network_features(net, 'pool8', mean_bgr=(104, 117, 123), geometry=geometry)
    cases = ('case1', 'case2') if o.align == 'both' else (o.align,)
    features = np.empty((len(cases), len(drive.files), extractor.dim), np.float16)
    for case, align in zip(features, cases):
        describe = recognition.from_scan(extractor, align, geometry)
        for i, file in enumerate(drive.files):
            case[i] = describe(datasets.read_scan(file))
    numbers = principal_components(features.reshape(-1, extractor.dim), 400)
    numbers = (numbers / np.linalg.norm(numbers, axis=1, keepdims=True)).reshape(len(cases), len(drive.files), -1)
    answers = []
    for i in drive.queries():
        found = (numbers[0, :drive.candidates[i]] @ numbers[:, i].T).max(1)  # database in the first case, queries in each
        best = np.sort(found)[::-1][:4]
        answers.append((i, int(found.argmax()), float(2 * best[0] - best[-1]), None))
    return answers


def answers_of(drive, o):
    if o.method == 'cnn':
        return by_network(drive, o)
    if o.method == 'map-closures':
        from local_maps import closures
        return closures(drive, o.local_map)
    if o.method == 'learnt':
        from discriminants import learnt_answers
        return learnt_answers(drive, o.discriminants, o.feature)
    from revisit import datasets, maps, recognition
    if o.method == 'ring':
        sensor = o.sensor or recognition.choose_ring_model([datasets.read_scan(drive.files[0])[:, :3].copy()])[0]
        model = recognition.read_ring_model(o.ring) if o.ring else None
        return by_detector(drive, maps.open_map(None, sensor, model=model, local_map=o.local_map), not o.no_verify)
    feature = recognition.m2dp_features() if o.method == 'm2dp' else recognition.scan_context_features(
        recognition.ScanContextOptions(candidates=o.ring_keys))
    return by_detector(drive, maps.Map(extractor=feature), False)


def perturbed(drive, o):
    """Rows of `revisit eval --perturb`: perturbed scans are queries against the unperturbed drive, earlier and later ones."""
    if isinstance(drive, TwoLaps):
        pairs = ','.join(str(o.drive / file) for file in TwoLaps.FILES if (o.drive / file).exists())
        truth = [o.drive, '--pairs', f'{pairs},near={TwoLaps.NEAR}']
    else:
        truth = [o.drive / 'bin', '--poses', o.drive / 'poses_kitti.txt', '--pose-frame', 'lidar', '--exclusion', f'meters={RECENT}',
                 '--radius', str(RADIUS), '--negative-radius', str(NEGATIVE_RADIUS)]
    words = [os.environ.get('REVISIT', 'build/release/tools/revisit'), 'eval', *truth, '--feature', o.method, '--perturb', o.perturb,
             '--queries', '200', '--format', 'json', '--no-report', '-q']
    for task in json.loads(subprocess.run([str(word) for word in words], check=True, stdout=subprocess.PIPE).stdout)['tasks']:
        at = task['metrics']
        yield {'perturbation': at['perturbation'], 'with_place': at['n_positives'], 'ap': float(at['average_precision']),
               'recall_at_1': float(at['recall_at_1'])}


def origin():
    def of_git(*words):
        return subprocess.run(['git', '-C', ROOT, *words], capture_output=True, text=True).stdout.strip()
    import revisit
    model = re.search(r'model name\s*:\s*(.*)', Path('/proc/cpuinfo').read_text())
    machine = f'{model[1] if model else platform.processor()}, {platform.system()} {platform.machine()}'
    changed = '+' if of_git('status', '--porcelain', '--untracked-files=no', '--', '.', ':!docs/data') else ''
    return {'version': revisit.__version__, 'commit': of_git('rev-parse', '--short=10', 'HEAD') + changed, 'machine': machine}


IDENTITY = ('drive', 'name', 'keyframes', 'perturbation')


def is_of(row, asked):
    return all(row.get(key) == asked.get(key) for key in IDENTITY)


def keep(file, row):
    """Replaces or appends a row. Safe for concurrent processes."""
    with open(file, 'a+') as opened:
        fcntl.flock(opened, fcntl.LOCK_EX)
        opened.seek(0)
        text = opened.read()
        rows = [known for known in (json.loads(text) if text else []) if not is_of(known, row)] + [row]
        opened.truncate(0)
        opened.write('[\n' + ',\n'.join(json.dumps(known, ensure_ascii=False) for known in rows) + '\n]\n')


def record(row, made, o):
    """Prints the row, and adds it to o.json (if given) with its origin and this command."""
    print(json.dumps(row))
    if o.json:
        words = [word for word in sys.argv[1:] if word != '--missing']
        del words[(at := words.index('--json')):at + 2]
        keep(o.json, row | made | ({'cheap': True} if o.cheap else {}) |
             {'command': shlex.join([f'bench/{Path(sys.argv[0]).name}', *words])})


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('drive', type=Path)
    parser.add_argument('--method', required=True, choices=('ring', 'scan-context', 'm2dp', 'cnn', 'learnt', 'map-closures'))
    parser.add_argument('--name', help='name of the row (default: the method)')
    parser.add_argument('--sensor', help='ring: sensor of the model (default: the closest); cnn: sensor of the range image')
    parser.add_argument('--no-verify', action='store_true', help='ring: do not register places')
    parser.add_argument('--ring', type=Path, help='ring model file (default: that of the sensor)')
    parser.add_argument('--ring-keys', type=int, default=0, help='number of candidates by ring keys; 0: all')
    parser.add_argument('--align', default='case1', help='cnn: none, case1, or both (query in both cases, as in the paper on 08)')
    parser.add_argument('--model', type=Path, help='folder with deploy.prototxt and weights.caffemodel')
    parser.add_argument('--discriminants', type=Path)
    parser.add_argument('--feature', default='scan-context', help='learnt: scan-context or m2dp')
    parser.add_argument('--local-map', type=float, default=0, metavar='METERS', help='length of local maps (ring, map-closures)')
    parser.add_argument('--keyframes', type=float, metavar='METERS', help='distance of keyframes (default: all scans)')
    parser.add_argument('--perturb', help='perturbations as in `revisit eval`, or standard')
    parser.add_argument('--json', type=Path)
    parser.add_argument('--missing', action='store_true', help='do nothing if FILE has the row')
    parser.add_argument('--cheap', action='store_true', help='mark the row to be run again by the test documents.rows')
    o = parser.parse_args()
    made = origin()  # before the run, because files may change meanwhile
    drive = open_drive(o.drive)
    row = {'drive': drive.name, 'name': o.name or o.method}
    if o.keyframes:
        drive = drive.keyframes(o.keyframes)
        row['keyframes'] = o.keyframes
    if o.missing and o.json and o.json.exists() and any(is_of(known, row) for known in json.loads(o.json.read_text())):
        return
    for found in perturbed(drive, o) if o.perturb else [figures(drive, answers_of(drive, o))]:
        record(row | {key: round(value, 4) if isinstance(value, float) else value for key, value in found.items()}, made, o)


if __name__ == '__main__':
    main()
