#!/usr/bin/env python3
"""Runs one row of each table of numbers in README.md, docs/ and docs/reference/ again, or prints why not.

  tests/documents/table_rows.py PROGRAM

A table behind <!-- table: FILE ... --> is of docs/data/FILE, whose cheap row bench/rows.py --rerun measures again (test documents.rows). For the
others ROWS has, by page and section, a function or a reason. A table of numbers that neither covers is a fault.
"""

import json
import re
import subprocess
import sys
import tempfile
from pathlib import Path

from documents import ROOT, split

NUMBER = re.compile(r'[~*]*[-+]?\d[\d,.e+-]*\b')
MOSTLY = 0.4  # of the cells behind the first column
MACHINE = 'times and memory of the machine that the page names'
LONG = 'simulates or computes for minutes to hours; the commands are behind the table'
FOREIGN = 'needs drives or scans that are not part of the project'
PUBLISHED = 'published by others'
TESTED = 'compared by the tests of this section'


def output(program, *arguments, cwd=None):
    return subprocess.run([program, *arguments], check=True, capture_output=True, text=True, cwd=cwd)


def thresholds(program, rows, folder):
    """Thresholds for a target precision of 0.95, by sensor."""
    output(program, 'simulate', '-q', '-o', 'few', '--sensor', 'vlp16', '--length', '300', '--every', '100', cwd=folder)
    found = []
    for sensor in ('hdl64', 'vlp16', 'ouster-os1-64'):
        notes = output(program, 'loops', 'few', '--sensor', sensor, '--no-verify', '--target-precision', '0.95', cwd=folder).stderr
        found.append(re.search(r'a score of at least (\d\.\d+)', notes)[1])
    return next(row[1:] for row in rows if row[0].endswith('for 0.95')), found


def sensors(program, rows, folder):
    """Beams, edges and closing of each sensor."""
    listed = {}
    for line in output(program, 'loops', '--sensor', 'list').stdout.splitlines()[1:]:
        words = line.split()
        listed[words[0]] = words[-3] + ' x ' + words[-1]
    return [(row[0].strip('`'), row[4]) for row in rows], [(row[0].strip('`'), listed.get(row[0].strip('`'))) for row in rows]


def preset(program, rows, folder):
    """Number of scans of the first preset."""
    name = rows[0][0].strip('`')
    output(program, 'simulate', '-q', '-o', 'preset', '--preset', name, cwd=folder)
    return rows[0][1], str(len(list((folder / 'preset').rglob('*.bin'))))


def surroundings(program, rows, folder):
    """AP and recall at precision 1 of the ring descriptor on a motorway, the fourth column."""
    output(program, 'simulate', '-q', '-o', 'drive', '--surroundings', 'motorway', '--route', 'both', '--length', '2400', '--every', '8',
           '--seed', '21', cwd=folder)
    run = output(program, 'eval', 'drive', '--feature', 'ring', '--protocol', 'online', '--format', 'json', '--no-report', '-q', '-o', 'out',
                 cwd=folder)
    metrics = json.loads(run.stdout)['tasks'][0]['metrics']
    found = [f'{metrics[key]:.3f}' for key in ('average_precision', 'max_recall_at_precision_1')]
    return [row[4] for row in rows if row[0].endswith('ring descriptor')], found


ROWS = {
    'docs/CALIBRATION.md': {'': thresholds},
    'docs/INSTALL.md': {'': 'sizes of packages, which packaging/ measures in clean roots'},
    'docs/MAPS.md': {'': LONG},
    'docs/MODELS.md': {'': MACHINE},
    'docs/RESULTS.md': {'': LONG, 'Real drives': FOREIGN},
    'docs/SLAM.md': {'': LONG},
    'docs/reference/ACCURACY.md': {'': 'needs outputs of the original Caffe that are not part of the project'},
    'docs/reference/COMPATIBILITY.md': {'': 'needs models of others'},
    'docs/reference/EVALUATION.md': {'': TESTED, 'Published values (not ours)': PUBLISHED, 'Perturbed real drives': FOREIGN},
    'docs/reference/FORMATS.md': {'': sensors, 'Size of maps': FOREIGN},
    'docs/reference/PAPER.md': {'': LONG, 'The 12 real scans': FOREIGN},
    'docs/reference/SIMULATION.md': {'': LONG, 'Places on a tripod': preset, 'Other surroundings': surroundings},
    'docs/reference/SPEED.md': {'': MACHINE},
}


def tables_of(page):
    """Yields line, sections from the innermost, rows, and whether docs/data/ has it, of each table of numbers."""
    lines, sections = split(page)[1], []
    at = 0
    while at < len(lines):
        heading = re.match(r'(#+) (.*)', lines[at])
        if heading:
            sections = [heading[2], *sections[max(0, len(sections) - len(heading[1]) + 1):]]
        begin = at
        while at < len(lines) and lines[at].startswith('|'):
            at += 1
        if at - begin > 2:
            rows = [[cell.strip() for cell in line.strip().strip('|').split('|')] for line in lines[begin + 2:at]]
            cells = [cell for row in rows for cell in row[1:]]
            if sum(bool(NUMBER.match(cell)) for cell in cells) >= MOSTLY * len(cells):
                yield begin + 1, sections, rows, lines[begin - 1].startswith('<!-- ')
        at = max(at, begin + 1)


def checked(program, page, sections, rows, folder):
    """Returns what is printed of a table, and whether it is a fault."""
    known = ROWS.get(page, {})
    what = next((known[section] for section in sections if section in known), known.get(''))
    if not callable(what):
        return what or 'neither measured again nor with a reason: see ROWS', what is None
    written, found = what(program, rows, folder)
    return 'as measured now' if written == found else f'the page has {written}, now {found}', written != found


def main():
    program, faults = str(Path(sys.argv[1]).resolve()), 0
    for page in [ROOT / 'README.md', *sorted((ROOT / 'docs').glob('*.md')), *sorted((ROOT / 'docs/reference').glob('*.md'))]:
        name = str(page.relative_to(ROOT))
        for line, sections, rows, is_of_data in tables_of(page):
            with tempfile.TemporaryDirectory(prefix='revisit_rows_') as folder:
                text, fault = ('test documents.rows', False) if is_of_data else checked(program, name, sections, rows, Path(folder))
            print(f'{name}:{line}: {text}', flush=True)
            faults += fault
    print(f'{faults} faults')
    return 1 if faults else 0


if __name__ == '__main__':
    sys.exit(main())
