#!/usr/bin/env python3
"""Effect of deskewing on loops: average precision and registration error on a drive with poses.

  revisit simulate -o plain && revisit simulate -o rolling --rolling-shutter
  env PYTHONPATH=build/dev/python python3 bench/deskewing.py plain rolling

A query has a place if one is within 5 m and at least 50 m earlier on the path.
"""

import argparse

import numpy as np

from revisit import LoopDetector, open_map
from revisit.loops import recognize
from revisit.recordings import open_recording

RADIUS, EXCLUDED = 5, 50
"""[m]"""


def measured(data, sequence, sensor, deskew, local_map):
    """Returns average precision, recall@1, number of queries with a place, and registration errors [m], [rad]."""
    recording = open_recording(data, sequence=sequence)
    detector = LoopDetector(open_map(None, sensor, threads=2), exclusion=f'meters={EXCLUDED}', local_map=local_map)
    path, along, matches, places, errors = [], [], [], 0, []
    for visit in recognize(recording.scans(), detector, deskew):
        here = visit.scan.pose[:3, 3]
        along.append(along[-1] + np.linalg.norm(here - path[-1]) if path else 0)
        path.append(here)
        earlier = np.array(path)[np.array(along) < along[-1] - EXCLUDED]
        if visit.loop is None:
            continue
        places += bool((np.linalg.norm(earlier - here, axis=1) < RADIUS).any())
        right = np.linalg.norm(visit.loop.pose[:3, 3] - here) < RADIUS
        matches.append((visit.loop.score, right))
        if visit.accepted and right:
            wrong = np.linalg.inv(np.linalg.inv(visit.loop.pose) @ visit.scan.pose) @ visit.registered.T_place_query
            errors.append((np.linalg.norm(wrong[:3, 3]), np.arccos(np.clip((np.trace(wrong[:3, :3]) - 1) / 2, -1, 1))))
    right = np.array([right for _, right in sorted(matches, reverse=True)], float)
    precision = np.cumsum(right) / np.arange(1, len(right) + 1)
    return (precision * right).sum() / places, right.sum() / places, places, np.array(errors)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('drives', nargs='+')
    parser.add_argument('--sequence', default='')
    parser.add_argument('--sensor', default='hdl64')
    parser.add_argument('--local-map', type=float, default=0)
    parser.add_argument('--no-deskew', action='store_true')
    o = parser.parse_args()
    for drive in o.drives:
        ap, recall, places, errors = measured(drive, o.sequence, o.sensor, not o.no_deskew, o.local_map)
        medians = np.median(errors, axis=0) * [1000, np.degrees(1)] if len(errors) else (np.nan, np.nan)
        print(f'{drive}: AP {ap:.3f}, recall@1 {recall:.3f} of {places} queries; {len(errors)} registered, '
              f'median error {medians[0]:.1f} mm, {medians[1]:.3f} deg', flush=True)


if __name__ == '__main__':
    main()
