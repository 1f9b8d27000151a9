#!/usr/bin/env python3
"""Robustness of features to perturbed scans of a real drive, by `revisit eval --perturb`, as rows for tables.py.

  perturbed_scans.py DRIVE [--perturb sector=180 ...] [--json FILE]

DRIVE: a folder for drives.py, with poses or lists of pairs. Perturbed scans are queries against the unperturbed drive. Matches
within 5 m are correct; earlier and later scans are candidates.
"""

import argparse
import json
import os
import subprocess
from pathlib import Path

from drives import RECENT, RADIUS, NEGATIVE_RADIUS, TwoLaps
from real_drives import origin, record

NAMES = {'ring': 'rings', 'scan-context': 'Scan Context'}


def truth_of(drive):
    if (drive / 'first').is_dir():
        pairs = ','.join(str(drive / file) for file in TwoLaps.FILES if (drive / file).exists())
        return [drive, '--pairs', f'{pairs},near={TwoLaps.NEAR}']
    return [drive / 'bin', '--poses', drive / 'poses_kitti.txt', '--pose-frame', 'lidar', '--exclusion', f'meters={RECENT}',
            '--radius', str(RADIUS), '--negative-radius', str(NEGATIVE_RADIUS)]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('drive', type=Path)
    parser.add_argument('--perturb', action='append', default=[], help='perturbation as in `revisit eval`; may be repeated (default: the standard ones)')
    parser.add_argument('--feature', default=','.join(NAMES))
    parser.add_argument('--queries', default='200')
    parser.add_argument('--json', type=Path)
    parser.add_argument('--cheap', action='store_true', help='mark the row to be run again by the test documents.rows')
    o = parser.parse_args()
    made = origin()
    for feature in o.feature.split(','):
        words = [os.environ.get('REVISIT', 'build/release/tools/revisit'), 'eval', *truth_of(o.drive), '--feature', feature,
                 '--perturb', ','.join(o.perturb) or 'standard', '--queries', o.queries, '--format', 'json', '--no-report', '-q']
        found = json.loads(subprocess.run([str(word) for word in words], check=True, stdout=subprocess.PIPE).stdout)
        for task in found['tasks']:
            at = task['metrics']
            row = {'drive': o.drive.name, 'name': NAMES[feature], 'perturbation': at['perturbation'], 'with_place': at['n_positives'],
                   'ap': round(float(at['average_precision']), 4), 'recall_at_1': round(float(at['recall_at_1']), 4)}
            record(row, made, o)


if __name__ == '__main__':
    main()
