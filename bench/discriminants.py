#!/usr/bin/env python3
"""Scan Context and M2DP with the discriminant analysis of ring descriptors (docs/reference/METHODS.md), trained on the same drives.

  revisit simulate -o town-3 --route both --length 2400 --every 4 --seed 3          (and 7, 8; delete the folders after `features`)
  discriminants.py features town-3 -o town-3.npz
  discriminants.py learn town-3.npz town-7.npz town-8.npz -o towns.npz
  foreign.py DATA --method learnt --discriminants towns.npz --feature scan-context|m2dp

A Scan Context [20 heights][60 sectors] is treated like a ring descriptor: the mean of the drive's first scans is subtracted, a
Fourier series over the azimuth only changes phases when rotated, each frequency has its own discriminant analysis of 20 complex
dimensions, and descriptors are compared at 360 yaw angles. M2DP is invariant to yaw: one analysis of its 192 dimensions, compared by
cosine. Both are trained on every scan, two random augmentations, and all pairs of one drive within 5 m, with b rotated to the yaw of
a. The regularization is that of ring descriptors.
"""

import argparse

import numpy as np

FREQUENCIES = 17
AUGMENTED = 2
WARMUP = 128
"""Scans from which the mean of a drive is estimated, as in `revisit loops`. It is subtracted from these scans, too."""
NEIGHBORS = 10
"""Keyframes before and after the best match that count as the same place."""
REGULARIZATION, MOST, NUMBERS = 0.01, 0.98, 512


def features_of(files, augmentations=(), names=('scan-context', 'm2dp')):
    """Returns {name: float32 [n][1 + augmentations][dimensions]}. augmentations: indices of the augmentations."""
    from revisit import datasets, recognition
    makers = {'scan-context': recognition.scan_context_features, 'm2dp': recognition.m2dp_features}
    describe = {name: recognition.from_scan(makers[name]()) for name in names}
    rows = {name: [] for name in names}
    for i, file in enumerate(files):
        points = datasets.read_scan(file)
        copies = [points, *(datasets.perturb(points, i << 8 | copy) for copy in augmentations)]
        for name in names:
            rows[name].append([describe[name](copy if len(copy) else points) for copy in copies])
    return {name: np.array(features, np.float32) for name, features in rows.items()}


def spectrum(contexts):
    """Converts [n][20 x 60] to complex [frequency][n][20]. Sectors are counter-clockwise."""
    rings = contexts.reshape(len(contexts), 20, 60)
    return (np.fft.rfft(rings, axis=2)[:, :, :FREQUENCIES] / np.sqrt(60)).transpose(2, 0, 1)


def seen_sectors(contexts):
    """Returns a mask with the shape of `contexts`: 1 in sectors with returns."""
    return np.tile(contexts.reshape(-1, 20, 60).any(1), 20)


def mean_of(name, features):
    """Returns the mean over scans with returns in the sector, as for ring descriptors."""
    return features.sum(0) / np.maximum(seen_sectors(features).sum(0), 1) if name == 'scan-context' else features.mean(0)


def as_numbers(name, features, mean):
    """Returns centered features [frequency][n][d]; M2DP has only frequency 0. Sectors without returns have the mean."""
    centred = features - mean
    return spectrum(centred * seen_sectors(features)) if name == 'scan-context' else centred[None].astype(complex)


def eigenpairs(shared, total):
    """Returns l and v, largest first, with shared v = l total v and v^H total v = 1."""
    root = np.linalg.inv(np.linalg.cholesky(total))
    values, vectors = np.linalg.eigh(root @ shared @ root.conj().T)
    return values[::-1], (root.conj().T @ vectors)[:, ::-1]


def learn(name, drives):
    """Returns the directions of each frequency, times the square root of their eigenvalues, [d][kept].

    drives: {name: features, 'pairs': [p][2], 'turns': relative yaw [p]}.
    """
    totals = shared = means = 0
    scans = sum(len(drive[name]) for drive in drives)
    for drive in drives:
        copies = drive[name].swapaxes(0, 1)
        mean = mean_of(name, copies[0])
        ways = [as_numbers(name, copy, mean) for copy in copies]
        totals = totals + sum(np.einsum('fnd,fne->fde', x, x.conj()) for x in ways) / len(ways)
        means = means + as_numbers(name, mean[None], 0)[:, 0] * len(copies[0]) / scans
        x = sum(ways) / len(ways)  # averaging over pairs of augmentations equals pairing the averages
        a, b = drive['pairs'].T
        turn = np.exp(1j * np.arange(len(x))[:, None] * drive['turns'])[:, :, None]
        product = np.einsum('fnd,fne->fde', x[:, a], (x[:, b] * turn).conj())
        shared = shared + (product + product.conj().swapaxes(1, 2)) / 2
    shared = shared / sum(len(drive['pairs']) for drive in drives)
    totals = totals / scans
    unit = np.trace(totals, axis1=1, axis2=2).real.sum()
    found = []
    for f, (total, common) in enumerate(zip(totals / unit, shared / unit)):
        if f > 0:  # at another yaw, the mean is subtracted at the wrong angle; down-weights its direction
            total = total + np.outer(means[f], means[f].conj()) / unit
        total = total + max(REGULARIZATION * np.trace(total).real / len(total), 1e-12) * np.eye(len(total))
        worth, vectors = eigenpairs(common, total)
        worth = np.clip(worth, 0, MOST)
        found += [(w, f, np.sqrt(w) * v) for w, v in zip(worth, vectors.T)]
    found.sort(key=lambda one: -one[0])
    used = np.cumsum([1 if f == 0 else 2 for _, f, _ in found])
    kept = [one for one, numbers in zip(found, used) if numbers <= NUMBERS and one[0] > 0]
    return [np.array([v for _, at, v in kept if at == f]).reshape(-1, totals.shape[1]).T for f in range(len(totals))]


def descriptors(name, features, mean, directions):
    """Returns a list of complex [n][kept] per frequency, jointly normalized to unit length."""
    numbers = [x @ v.conj() for x, v in zip(as_numbers(name, features, mean), directions)]
    squares = sum((np.abs(z) ** 2).sum(1) * (1 if f == 0 else 2) for f, z in enumerate(numbers))
    return [z / np.sqrt(np.maximum(squares, 1e-30))[:, None] for z in numbers]


def similarities(numbers, query, places, turns=360):
    """Returns the similarities of `query` to the rows `places`, at the best yaw angle."""
    products = np.array([z[places] @ z[query].conj() for z in numbers])
    if len(products) == 1:
        return products[0].real
    padded = np.zeros((turns // 2 + 1, len(places)), complex)
    padded[:len(products)] = products
    return np.fft.irfft(padded, n=turns, axis=0).max(0) * turns


def learnt_answers(drive, file, name):
    """Scores by 2 c1 - c4, with c4 among places that are not neighbors of the best. It was the best of three scores on real drives."""
    learnt = np.load(file)
    directions = [learnt[f'{name} {f}'] for f in range(int(learnt[f'{name} frequencies']))]
    features = features_of(drive.files, names=[name])[name][:, 0]
    numbers = descriptors(name, features, mean_of(name, features[drive.stored[:WARMUP]]), directions)
    answers = []
    for query, n in zip(drive.queries, drive.candidates):
        found = similarities(numbers, query, drive.stored[:n])
        best = int(found.argmax())
        others = np.sort(found[np.abs(np.arange(len(found)) - best) > NEIGHBORS])[::-1]
        score = 2 * found[best] - (others[:4][-1] if len(others) else found[best])
        answers.append((drive.stored[best], float(score), None))
    return answers


def features_command(o):
    from drives import RADIUS, open_drive
    drive = open_drive(o.inputs[0])
    apart = np.linalg.norm(drive.at[:, None] - drive.at[None], axis=2)
    pairs = np.argwhere(np.triu(apart < RADIUS, 1))
    heading = np.arctan2(-drive.poses[:, 0, 0], drive.poses[:, 2, 0])  # yaw of the sensor's x, CCW; world: x right, z forward
    turns = heading[pairs[:, 0]] - heading[pairs[:, 1]]
    np.savez(o.output, pairs=pairs, turns=turns, **features_of(drive.files, range(1, AUGMENTED + 1)))
    print(f'{len(drive.files)} scans, {len(pairs)} pairs')


def learn_command(o):
    drives = [np.load(file) for file in o.inputs]
    result = {}
    for name in ('scan-context', 'm2dp'):
        directions = learn(name, drives)
        result |= {f'{name} {f}': v for f, v in enumerate(directions)} | {f'{name} frequencies': len(directions)}
        print(name, 'directions kept per frequency:', *(v.shape[1] for v in directions))
    np.savez(o.output, **result)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('what', choices=('features', 'learn'))
    parser.add_argument('inputs', nargs='+')
    parser.add_argument('-o', '--output', required=True)
    o = parser.parse_args()
    (features_command if o.what == 'features' else learn_command)(o)


if __name__ == '__main__':
    main()
