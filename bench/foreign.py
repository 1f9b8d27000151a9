#!/usr/bin/env python3
"""Evaluates a method that revisit does not have, causally, on a drive given as to `revisit eval`. Prints metrics as in run.json.

  foreign.py DATA --method learnt --feature scan-context --discriminants towns.npz                     (discriminants.py)
  foreign.py DATA --poses FILE --pose-frame lidar --exclusion meters=50 --method map-closures --local-map 100
  foreign.py DATA --pairs FILE,near=2 ...                       (needs `pip install map-closures kiss-icp`: local_maps.py)

Needs the Python package of revisit. rows.py adds the metrics to docs/data/.
"""

import argparse
import json
from pathlib import Path

import revisit
from discriminants import learnt_answers
from drives import RADIUS, metrics, open_drive


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('data', type=Path)
    parser.add_argument('--method', required=True, choices=('learnt', 'map-closures'))
    parser.add_argument('--feature', default='scan-context', help='learnt: scan-context or m2dp')
    parser.add_argument('--discriminants', type=Path)
    parser.add_argument('--local-map', type=float, metavar='METERS', help='map-closures: length of local maps')
    parser.add_argument('--poses', type=Path, help='T_world_lidar by frame, in KITTI\'s format (default: those of KITTI\'s layout)')
    parser.add_argument('--pose-frame', choices=['lidar'])
    parser.add_argument('--pairs', default='')
    parser.add_argument('--exclusion', default='frames=50')
    parser.add_argument('--negative-radius', type=float, default=2 * RADIUS)
    parser.add_argument('--keyframes', default='meters=0')
    o = parser.parse_args()
    drive = open_drive(o.data, trajectory=o.poses, pairs=o.pairs, exclusion=o.exclusion, negative_radius=o.negative_radius, keyframes=o.keyframes)
    if o.method == 'learnt':
        answers = learnt_answers(drive, o.discriminants, o.feature)
    else:
        from local_maps import closures
        answers = closures(drive, o.local_map)
    print(json.dumps({'info': {'version': revisit.__version__}, 'tasks': [{'metrics': metrics(drive, answers)}]}))


if __name__ == '__main__':
    main()
