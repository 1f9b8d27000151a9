#!/usr/bin/env python3
"""One method on one drive with revisits, causally: every keyframe is asked against those before it, then stored.

  real_drives.py DRIVE --method ring [--sensor vlp16] [--no-verify] [--local-map 10]      as `revisit loops` finds loops
  real_drives.py DRIVE --method ring --ring scans.ring --name 'rings without training'
  real_drives.py DRIVE --method scan-context [--ring-keys 10]
  real_drives.py DRIVE --method m2dp
  real_drives.py DRIVE --method cnn --align case1 --sensor hdl32 --model SQUEEZENET
  real_drives.py DRIVE --method learnt --feature scan-context --discriminants towns.npz      (discriminants.py)
  real_drives.py DRIVE --method map-closures --local-map 100          (needs `pip install map-closures kiss-icp`)

drives.py says what DRIVE may be, and what is right. Needs the Python package of revisit. Prints the figures; --json FILE adds them
to FILE, in the place of earlier ones of this drive and name, with version, commit, machine and command.
"""

import argparse
import json
import platform
import shlex
import subprocess
import sys
from pathlib import Path

import numpy as np
from drives import figures, open_drive

ROOT = Path(__file__).resolve().parents[2]


def by_recogniser(drive, recogniser):
    """As a robot asks: with the recogniser of the package, its score and its threshold."""
    from revisit import datasets
    answers, position, row = [], {}, {}
    for i, file in enumerate(drive.files):
        scan = recogniser.describe(datasets.read_scan(file))
        candidates = drive.candidates[i]
        if candidates > 0:
            loop = recogniser.query(scan, [at for k, at in position.items() if k >= candidates]) if scan.described else None
            known = recogniser.threshold is not None
            answers.append((i, row[loop.position], loop.score, loop.accepted if known else None) if loop else (i, None, 0, None))
        if scan.described:
            position[i] = recogniser.add(scan, frame=i)
            row[position[i]] = i
    return answers


def by_detector(drive, recogniser, verify, local_map):
    """As `revisit loops` does it: registered, unless told not to, and accepted by default."""
    from revisit import LoopDetector, datasets
    answers, row, detector = [], {}, None
    for i, file in enumerate(drive.files):
        if i in drive.starts:
            exclusion = 'metres=50' if drive.poses is not None else f'frames={len(drive.files)}'  # its own lap
            detector = LoopDetector(recogniser, drive=f'lap {i}', exclusion=exclusion, verify=verify, local_map=local_map)
        found = detector.take(datasets.read_scan(file), frame=i, pose=None if drive.poses is None else drive.poses[i])
        if drive.candidates[i] > 0:
            loop = found.loop
            answers.append((i, row[loop.position], loop.score, loop.accepted) if loop else (i, None, 0, None))
        if found.position is not None:
            row[found.position] = i
    return answers


def best_of(drive, similarities, k=4):
    """`similarities(query, candidates)` of descriptors, scored by 2 c1 - ck."""
    answers = []
    for i in drive.queries():
        found = np.asarray(similarities(i, drive.candidates[i]), float)
        best = np.sort(found)[::-1][:k]
        answers.append((i, int(found.argmax()), 2 * best[0] - best[-1], None))
    return answers


def principal_components(values, count):
    """[n][count] of the rows of `values`, from the n x n products of rows less their mean: `values` may be far wider than long."""
    n, products = len(values), 0
    for first in range(0, values.shape[1], 16384):
        block = values[:, first:first + 16384].astype(np.float32)
        block -= block.mean(0)
        products = products + block @ block.T
    spread, rows = np.linalg.eigh(products.astype(float))
    return (rows * np.sqrt(np.maximum(spread, 0)))[:, ::-1][:, :min(count, n - 1)]


def by_network(drive, o):
    """The paper's feature, 400 principal components; they are those of all scans of the drive, the one thing here not causal."""
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
    return best_of(drive, lambda i, n: (numbers[0, :n] @ numbers[:, i].T).max(1))  # stored in the first case, asked in each


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
        recogniser = maps.open_map(model=recognition.read_ring_model(o.ring)) if o.ring else maps.open_map(sensor=sensor)
        return by_detector(drive, recogniser, not o.no_verify, o.local_map)
    if o.method == 'scan-context':
        options = recognition.ScanContextOptions(ring_key_candidates=o.ring_keys)
        return by_recogniser(drive, maps.PlaceRecognizer(recognition.scan_context_features(options)))
    return by_recogniser(drive, maps.PlaceRecognizer(recognition.m2dp_features()))


def machine():
    model = [line.split(':')[1].strip() for line in Path('/proc/cpuinfo').read_text().splitlines() if line.startswith('model name')]
    return f'{model[0] if model else platform.processor()}, {platform.system()} {platform.machine()}'


def origin():
    """What a figure depends on beside its command."""
    def of_git(*words):
        return subprocess.run(['git', '-C', ROOT, *words], capture_output=True, text=True).stdout.strip()
    import revisit
    changed = '+' if of_git('status', '--porcelain', '--untracked-files=no') else ''
    return {'version': revisit.__version__, 'commit': of_git('rev-parse', '--short=10', 'HEAD') + changed, 'machine': machine()}


def keep(file, row):
    rows = json.loads(file.read_text()) if file.exists() else []
    rows = [known for known in rows if (known['drive'], known['name']) != (row['drive'], row['name'])] + [row]
    file.write_text('[\n' + ',\n'.join(json.dumps(known, ensure_ascii=False) for known in rows) + '\n]\n')


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('drive', type=Path)
    parser.add_argument('--method', required=True, choices=('ring', 'scan-context', 'm2dp', 'cnn', 'learnt', 'map-closures'))
    parser.add_argument('--name', help='of the row (default: the method)')
    parser.add_argument('--sensor', help="ring: whose model (default: the nearest); cnn: whose image")
    parser.add_argument('--no-verify', action='store_true', help='ring: do not register places')
    parser.add_argument('--ring', type=Path, help='a ring model (default: that of the sensor)')
    parser.add_argument('--ring-keys', type=int, default=0, help='candidates by ring keys; 0: all')
    parser.add_argument('--align', default='case1', help='cnn: none, case1, or both: asked in both cases, as the paper does on 08')
    parser.add_argument('--model', type=Path, help='folder of deploy.prototxt and weights.caffemodel')
    parser.add_argument('--discriminants', type=Path)
    parser.add_argument('--feature', default='scan-context', help='learnt: scan-context or m2dp')
    parser.add_argument('--local-map', type=float, default=0, metavar='METRES', help='ring: of the last metres; map-closures: of so many')
    parser.add_argument('--json', type=Path)
    parser.add_argument('--cheap', action='store_true', help='the test documents.rows is to run this row again')
    o = parser.parse_args()
    made = origin()  # of what runs now, whatever is changed meanwhile
    drive = open_drive(o.drive)
    row = {'drive': drive.name, 'name': o.name or o.method}
    row |= {key: round(value, 4) if isinstance(value, float) else int(value)
            for key, value in figures(drive, answers_of(drive, o)).items()}
    print(json.dumps(row))
    if o.json:
        words = sys.argv[1:]
        at = words.index('--json')
        del words[at:at + 2]
        keep(o.json, row | made | ({'cheap': True} if o.cheap else {}) |
             {'command': shlex.join(['tests/bench/real_drives.py', *words])})


if __name__ == '__main__':
    main()
