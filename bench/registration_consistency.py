#!/usr/bin/env python3
"""NEES of registrations: consistency of the information matrix, on pairs of scans of simulated drives, or of a real one with --poses.

  revisit simulate -o drive --route both --length 600 --every 3 --seed 21
  env PYTHONPATH=build/dev/python python3 bench/registration_consistency.py drive [DRIVE ...] --pairs 200

The NEES e^T I e of a consistent 6-DoF estimate has mean 6, median 5.35, 90th percentile 10.6; of 5 DoF without height, mean 5.
Drives along KITTI's routes are not suitable, because the height of their poses is not the town's.
"""

import argparse
import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / 'tests/python'))
from pairs import WITHOUT_HEIGHT, as_they_are, error_of, normalized_squares, pairs_of, real_pairs, registered  # noqa: E402

WRONG = 1  # error of a pair that fits another place [m]: it is counted, and has no part in the NEES


def row(name, results, dof=slice(6)):
    errors = np.array([error_of(found.T_place_query, truth) for truth, found in results if found.fits])
    meters, radians = (np.linalg.norm(errors[:, part], axis=1) for part in (slice(3), slice(3, 6)))
    right = meters < WRONG
    squares = normalized_squares(results, dof)[right]
    print(f'{name:26}{len(results):6}{len(squares):9}{np.sum(~right):6}{squares.mean():8.2f}{np.median(squares):8.2f}'
          f'{np.quantile(squares, 0.9):8.2f}{squares.max():9.1f}{np.median(meters):11.4f}{np.degrees(np.median(radians)):8.3f}', flush=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('drives', nargs='+')
    parser.add_argument('--poses', help='of the LiDAR on one real drive, KITTI format: takes consecutive scans, then revisits, as they are')
    parser.add_argument('--pairs', type=int, default=200, help='total number of pairs (default %(default)s)')
    o = parser.parse_args()
    print(f'{"drive":26}{"pairs":>6}{"accepted":>9}{"wrong":>6}{"mean":>8}{"median":>8}{"90 %":>8}{"largest":>9}{"error [m]":>11}{"[deg]":>8}')
    if o.poses:
        for name, pairs in real_pairs(o.drives[0], o.poses, o.pairs).items():
            results = list(registered(pairs, prepare=as_they_are))
            row(name, results)
            row(f'{name}, no height', results, WITHOUT_HEIGHT)
        return
    for drive in o.drives:
        row(Path(drive).name, list(registered(pairs_of(drive, o.pairs // len(o.drives)))))


if __name__ == '__main__':
    main()
