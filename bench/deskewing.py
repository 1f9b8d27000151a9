#!/usr/bin/env python3
"""Effect of deskewing on registration: error of the accepted loops of a drive with poses.

  revisit simulate -o plain && revisit simulate -o rolling --rolling-shutter
  env PYTHONPATH=build/dev/python python3 bench/deskewing.py plain rolling

A loop is correct within 5 m. `revisit eval` gives the average precision.
"""

import argparse

import numpy as np

from revisit import LoopDetector, open_map
from revisit.loops import recognize
from revisit.recordings import open_recording

RADIUS = 5  # [m]


def registration_errors(data, sensor, deskew):
    """Returns [correct loops][m, rad]."""
    detector = LoopDetector(open_map(None, sensor, threads=2), exclusion='meters=50')
    errors = []
    for visit in recognize(open_recording(data).scans(), detector, deskew):
        loop = visit.found.loop
        if visit.found.accepted and np.linalg.norm((loop.pose - visit.scan.pose)[:3, 3]) < RADIUS:
            wrong = np.linalg.inv(np.linalg.inv(loop.pose) @ visit.scan.pose) @ visit.found.registered.T_place_query
            errors.append((np.linalg.norm(wrong[:3, 3]), np.arccos(np.clip((np.trace(wrong[:3, :3]) - 1) / 2, -1, 1))))
    return np.array(errors)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('drives', nargs='+')
    parser.add_argument('--sensor', default='hdl64')
    parser.add_argument('--no-deskew', action='store_true')
    o = parser.parse_args()
    for drive in o.drives:
        errors = registration_errors(drive, o.sensor, not o.no_deskew)
        medians = np.median(errors, axis=0) * [1000, np.degrees(1)] if len(errors) else (np.nan, np.nan)
        print(f'{drive}: {len(errors)} registered, median error {medians[0]:.1f} mm, {medians[1]:.3f} deg', flush=True)


if __name__ == '__main__':
    main()
