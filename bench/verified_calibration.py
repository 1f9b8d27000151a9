#!/usr/bin/env python3
"""Calibration of registered loops (verified_calibration()) by SciPy, from output of `revisit loops`.

  revisit loops SCANS --all > town.csv                          # for each drive
  verified_calibration.py --drive street town.csv TOWN 5 1 ...  # prints the blocks of verified_calibration()

--drive KIND LINES POSES NEAR LIMIT: matches whose registered pose is off by at most LIMIT [m] are correct, and those nearer than NEAR [m]
that are not registered; matches farther than twice NEAR are incorrect, others ignored. POSES is a drive of KITTI's layout, or has 12
numbers of T_world_lidar for each frame. Each place has weight 1 (scores_by_place()). Incorrect matches are
reweighted to a prior of 10 % correct. The probability is an isotonic regression on the score. Then leaves out each kind of
surroundings in turn, and counts its matches of probability 0.99.
--pairs: of a drive without poses; listed places and two frames around them are correct; unlisted queries up to --none-before have none.
"""

import argparse
import csv
from pathlib import Path

import numpy as np
from acceptance import error_of, homogeneous, listed, truth
from scipy.optimize import isotonic_regression

RIGHT_SHARE = 0.1
STEP = 0.02  # scores are rounded down, so that the threshold keeps a distance from incorrect matches


def by_place(v, right, here):
    """Returns weights: all correct matches of a place (radius 5 m) have a total weight of 1, and all incorrect ones, too."""
    weight = np.zeros(len(v))
    for kind in (True, False):
        centres, of = [], []
        for i in np.flatnonzero(right == kind):
            of.append(next((k for k, c in enumerate(centres) if np.linalg.norm(c - here[i]) < 5), len(centres)))
            if of[-1] == len(centres):
                centres.append(here[i])
        if of:
            weight[right == kind] = 1 / np.bincount(of)[of]
    return weight


def of_poses(file, poses, near, limit):
    poses = truth(Path(poses)) if Path(poses).is_dir() else homogeneous(np.loadtxt(poses))
    v, right, here = [], [], []
    for row in csv.DictReader(open(file)):
        line = {key: int(row[key]) for key in ('frame', 'match_frame') if row[key]}
        if len(line) == 2:
            apart = np.linalg.norm(poses[line['frame'], :3, 3] - poses[line['match_frame'], :3, 3]) / float(near)
            if row['x']:
                line['registered'] = {key: float(row[key]) for key in ('x', 'y', 'z', 'qx', 'qy', 'qz', 'qw')}
                meters, degrees = error_of(line, poses)
                apart = 0 if meters <= float(limit) and degrees <= 10 else max(apart, 1.5) if apart < 1 else apart
            if not 1 <= apart <= 2:
                v, right, here = [*v, float(row['score'])], [*right, apart < 1], [*here, poses[line['frame'], :3, 3]]
    v, right, here = map(np.array, (v, right, here))
    return v, right, by_place(v, right, here)


def of_pairs(file, lists, none_before):
    places, v, right, frames = listed(map(Path, lists)), [], [], []
    for row in csv.DictReader(open(file)):
        frame = int(row['frame'])
        if row['match_drive'] != row['drive'] and row['score'] and (frame in places or frame <= none_before):
            v.append(float(row['score']))
            right.append(any(abs(int(row['match_frame']) - place) <= 2 for place in places.get(frame, [])))
            frames.append(frame)
    here = 2.0 * np.array(frames)[:, None]  # keyframes are about 2 m apart
    v, right = np.array(v), np.array(right)
    return v, right, by_place(v, right, here)


def blocks(drives):
    """Isotonic regression: returns [(lowest score, matches, correct)].

    Like Calibration, adds one correct match to the lowest block and one incorrect match to the highest.
    """
    v, right, weight = (np.concatenate(each) for each in zip(*drives))
    weight = np.where(right, 1, weight[right].sum() / weight[~right].sum() * (1 - RIGHT_SHARE) / RIGHT_SHARE) * weight
    step = np.floor(v / STEP)
    step, at = np.unique(np.where(step == -1, -2, step), return_inverse=True)  # nothing is learned about scores just below 0
    matches, found = np.bincount(at, weight), np.bincount(at, weight * right)
    first, last = np.eye(len(step))[[0, -1]]
    share = isotonic_regression((found + first) / (matches + first + last), weights=matches + first + last).x
    starts = np.flatnonzero(np.r_[True, np.diff(share) > 1e-9])
    return list(zip(step[starts] * STEP, np.add.reduceat(matches, starts), np.add.reduceat(found, starts)))


def threshold(found, precision=0.99):
    """The lowest score from which on each block is correct with this probability."""
    low = [i for i, (_, matches, correct) in enumerate(found) if correct < precision * matches]
    return found[low[-1] + 1][0] if low[-1] + 1 < len(found) else np.inf


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--drive', nargs=5, metavar=('KIND', 'LINES', 'POSES', 'NEAR', 'LIMIT'), action='append', default=[])
    parser.add_argument('--pairs', nargs='+', metavar='KIND LINES LIST...', action='append', default=[])
    parser.add_argument('--none-before', type=int, default=-1)
    o = parser.parse_args()
    drives = [(kind, file, of_poses(file, *rest)) for kind, file, *rest in o.drive]
    drives += [(kind, file, of_pairs(file, lists, o.none_before)) for kind, file, *lists in o.pairs]
    for kind, name, (v, right, weight) in drives:
        print(f'// {kind}, {name}: {len(v)} matches, {right.sum()} right; of {weight.sum():.0f} places; right 5 % '
              f'{np.quantile(v[right], .05) if right.any() else np.nan:.2f}; wrong highest {v[~right].max() if (~right).any() else np.nan:.2f}')
    print('\n'.join('{{{:.4f}, {:.4f}, {:.4f}}},'.format(*block) for block in blocks([drive for *_, drive in drives])))
    for left in sorted({kind for kind, *_ in drives}):
        least = threshold(blocks([drive for kind, _, drive in drives if kind != left]))
        v, right, _ = (np.concatenate(each) for each in zip(*(drive for kind, _, drive in drives if kind == left)))
        print(f'// without {left}: {left} has {(right & (v >= least)).sum()} correct, {(~right & (v >= least)).sum()} incorrect from {least:.2f} on')


if __name__ == '__main__':
    main()
