#!/usr/bin/env python3
"""Detects loop closures online: prints one line per loop.

  loop_closures.py scans/ --map town.map      # any recording of revisit.recordings
"""

import argparse
import sys

import numpy as np

import revisit
from revisit import recordings
from revisit.loops import recognize


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('data')
    parser.add_argument('--map', help='map file (default: none)')
    parser.add_argument('--threshold', type=float, help='minimum score (default: for a precision of 0.99)')
    parser.add_argument('--exclusion', default='meters=30', help='recent scans that are not compared (default: %(default)s)')
    o = parser.parse_args()

    recording = recordings.open_recording(o.data)
    detector = revisit.LoopDetector(o.map, exclusion=o.exclusion, threshold=o.threshold)
    print('frame,entry,match_frame,score,relative_yaw_deg')
    for scan, found, _ in recognize(recording.scans(), detector):
        if found.error:
            print(f'{scan.source}: {found.error}', file=sys.stderr)
        for frame in found.questioned:
            print(f'later loops contradict that of frame {frame}', file=sys.stderr)
        if found.accepted and found.loop:
            loop, yaw = found.loop, found.loop.relative_yaw or 0
            print(f'{scan.frame},{loop.id},{loop.frame},{loop.score:.3f},{np.degrees(yaw):.1f}')
    print(f'{len(detector.map)} map entries', file=sys.stderr)


if __name__ == '__main__':
    try:
        main()
    except revisit.Error as error:
        raise SystemExit(f'loop_closures: {error}')
