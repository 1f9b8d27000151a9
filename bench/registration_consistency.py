#!/usr/bin/env python3
"""NEES of registrations: consistency of the information matrix, on pairs of scans of simulated drives.

  revisit simulate -o drive --route both --length 600 --every 3 --seed 21
  env PYTHONPATH=build/dev/python python3 bench/registration_consistency.py drive [DRIVE ...] --pairs 200

The NEES e^T I e of a consistent 6-DoF estimate has mean 6, median 5.35, 90th percentile 10.6. Drives along KITTI's routes are not
suitable, because the height of their poses is not the town's.
"""

import argparse
import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / 'tests/python'))
from pairs import error_of, normalized_squares, pairs_of, registered  # noqa: E402


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('drives', nargs='+')
    parser.add_argument('--pairs', type=int, default=200, help='total number of pairs (default %(default)s)')
    o = parser.parse_args()
    print(f'{"drive":24}{"pairs":>6}{"accepted":>9}{"mean":>8}{"median":>8}{"90 %":>8}{"largest":>9}' f'{"error [m]":>11}{"[deg]":>8}')

    def row(name, results):
        squares = normalized_squares(results)
        errors = np.array([error_of(found.T_place_query, truth) for truth, found in results if found.fits])
        meters, degrees = (np.median(np.linalg.norm(errors[:, part], axis=1)) for part in (slice(3), slice(3, 6)))
        print(f'{name:24}{len(results):6}{len(squares):9}{squares.mean():8.2f}{np.median(squares):8.2f}'
              f'{np.quantile(squares, 0.9):8.2f}{squares.max():9.1f}{meters:11.4f}{np.degrees(degrees):8.3f}', flush=True)

    everything = []
    for n, drive in enumerate(o.drives):
        results = list(registered(pairs_of(drive, o.pairs // len(o.drives)), seed=n))
        row(Path(drive).name, results)
        everything += results
    row('all', everything)


if __name__ == '__main__':
    main()
