#!/usr/bin/env python3
"""Evaluates local maps of any window (meters before and after a keyframe, radius) on a drive with poses.

  windows.py DRIVE --sensor ouster-os1-64 --before 40 --after 20 --within 25
  windows.py DRIVE --sensor vlp16                                  single scans

`revisit loops --local-map METERS` equals --before METERS. --after delays answers by this distance. A window joins about 20 scans,
downsampled to voxels of 0.25 m. drives.py defines DRIVE. Needs the Python package of revisit. Prints the metrics.
"""

import argparse
import json
from pathlib import Path

import numpy as np
from drives import RECENT, figures, open_drive

VOXEL, RANGE, SCANS = 0.25, 80, 20


def within(points, meters):
    return points[(points * points).sum(1) < meters * meters]


def thinned(points):
    cells = np.floor(points / VOXEL).astype(np.int64) + (1 << 15)
    return points[np.unique(cells[:, 0] << 32 | cells[:, 1] << 16 | cells[:, 2], return_index=True)[1]]


def joined(scans, poses, way, i, o):
    """Returns the points of the window around keyframe `i`, in its frame. way: path length at each keyframe [m]."""
    chosen, last = [i], -np.inf
    for j in range(np.searchsorted(way, way[i] - o.before), np.searchsorted(way, way[i] + o.after, 'right')):
        if j != i and way[j] >= last + (o.before + o.after) / SCANS:
            chosen.append(j)
            last = way[j]
    moved = [scans[j] @ T[:3, :3].T + T[:3, 3] for j in chosen for T in [(np.linalg.inv(poses[i]) @ poses[j]).astype(np.float32)]]
    return np.ascontiguousarray(thinned(within(np.concatenate(moved), o.within)))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('drive', type=Path)
    parser.add_argument('--sensor', required=True, help='sensor of the ring model, or a ring model file')
    for name in ('before', 'after'):
        parser.add_argument(f'--{name}', type=float, default=0, metavar='METERS')
    parser.add_argument('--within', type=float, default=RANGE, metavar='METERS')
    parser.add_argument('--keyframes', type=float, metavar='METERS', help='distance of keyframes (default: all scans)')
    parser.add_argument('--places-from', type=float, default=0, metavar='METERS',
                        help='skip queries whose nearest place is earlier on the path')
    parser.add_argument('--verify', action='store_true', help='register places')
    o = parser.parse_args()
    from revisit import LoopDetector, datasets, maps, recognition
    drive = open_drive(o.drive)
    if o.keyframes:
        drive = drive.keyframes(o.keyframes)
    way = np.r_[0, np.cumsum(np.linalg.norm(np.diff(drive.poses[:, :3, 3], axis=0), axis=1))]
    scans = [thinned(within(datasets.read_scan(file)[:, :3], RANGE)) for file in drive.files]
    model = {'model': recognition.read_ring_model(o.sensor)} if o.sensor.endswith('.ring') else {'sensor': o.sensor}
    detector, answers = LoopDetector(maps.open_map(**model), exclusion=f'meters={RECENT}', verify=o.verify), []
    for i in range(len(scans)):
        loop = detector.take(joined(scans, drive.poses, way, i, o), frame=i, pose=drive.poses[i]).loop
        known = np.linalg.norm(drive.at[:drive.candidates[i]] - drive.at[i], axis=1)
        if len(known) and way[known.argmin()] >= o.places_from:
            answers.append((i, loop.frame, loop.score, loop.accepted) if loop else (i, None, 0, None))
    print(json.dumps({key: round(value, 4) if isinstance(value, float) else value for key, value in figures(drive, answers).items()}))


if __name__ == '__main__':
    main()
