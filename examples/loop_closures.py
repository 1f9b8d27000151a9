#!/usr/bin/env python3
"""Detects loop closures online: prints one line per loop, and plots them.

  loop_closures.py scans/ --map town.map -o loops.png      # .bin, .pcd or .ply files, or KITTI's layout
  loop_closures.py town --simulate                         # simulates a drive first
"""

import argparse
import sys

import numpy as np

import revisit
from revisit import datasets, recognition, simulation


def draw(file, drive, loops):
    import matplotlib
    matplotlib.use('Agg')
    from matplotlib import pyplot
    # KITTI's axes: x right, z forward.
    path = np.array([scan.pose[[0, 2], 3] if scan.pose is not None else (i, 0)
                     for i, scan in enumerate(drive.scans)])
    figure, axes = pyplot.subplots(figsize=(7, 7), layout='constrained')
    axes.plot(*path.T, '.-', color='lightgray')
    for here, there in loops:
        axes.plot(*path[[here, there]].T, color='tab:green')
        axes.plot(*path[here], 'o', color='tab:green')
    axes.set_aspect('equal', adjustable='datalim')
    axes.set_xlabel('[m]')
    axes.set_ylabel('[m]')
    axes.set_title(f'{len(loops)} loops')
    figure.savefig(file)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('folder')
    parser.add_argument('--sequence', default='', help='sequence of a KITTI root')
    parser.add_argument('--simulate', type=float, nargs='?', const=600, metavar='METERS',
                        help='simulate a drive of this length in the folder first (default: %(const)s)')
    parser.add_argument('--sensor', help='sensor of the ring model (default: detected)')
    parser.add_argument('--map', help='map file (default: none)')
    parser.add_argument('--threshold', type=float, help='minimum similarity + inlier ratio (default: for a precision of 0.99)')
    parser.add_argument('--exclusion', default='frames=50', help='recent scans that are not compared (default: %(default)s)')
    parser.add_argument('-o', '--output', help='plot to write (needs matplotlib)')
    o = parser.parse_args()

    if o.simulate:
        simulation.simulate(o.folder, length=o.simulate, every=20, progress=lambda done, total: print(
            f'\rsimulating {done}/{total}', end='' if done < total else '\n', file=sys.stderr))
    drive = datasets.open_dataset(o.folder, o.sequence)
    some = [datasets.read_scan(scan.file) for scan in drive.scans[:: max(1, len(drive.scans) // 3)]]
    sensor = o.sensor or recognition.choose_ring_model(some)[0]
    recognizer = revisit.open_map(o.map, sensor)

    detector = revisit.LoopDetector(recognizer, exclusion=o.exclusion, threshold=o.threshold)
    loops, scan_of_index = [], {}
    print('scan,entry,frame,score,relative_yaw_deg')
    for i, ref in enumerate(drive.scans):
        found = detector.take(datasets.read_scan(ref.file), frame=ref.frame, time=ref.time, pose=ref.pose)
        if found.error:
            print(f'{ref.file}: {found.error}', file=sys.stderr)
            continue
        if found.index is not None:
            scan_of_index[found.index] = i
        loop = found.loop
        if loop and loop.accepted:
            print(f'{ref.file.stem},{loop.id},{loop.frame},{loop.score:.3f},{np.degrees(loop.relative_yaw):.1f}')
            if loop.index in scan_of_index:
                loops.append((i, scan_of_index[loop.index]))
    print(f'{len(recognizer)} map entries, {len(loops)} loops in this drive', file=sys.stderr)
    if o.output:
        draw(o.output, drive, loops)


if __name__ == '__main__':
    try:
        main()
    except revisit.Error as error:
        raise SystemExit(f'loop_closures: {error}')
