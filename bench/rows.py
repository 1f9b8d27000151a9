#!/usr/bin/env python3
"""Adds the metrics of a command to a file of docs/data/: a row for each task, with version, commit, machine and command.

  rows.py FILE DRIVE NAME [--missing] [--cheap] -- revisit eval ../shared/real/nclt/bin ...
  rows.py FILE DRIVE NAME [--missing] [--cheap] -- bench/foreign.py ../shared/real/nclt/bin ...        (a foreign method)
  rows.py --rerun          runs rows marked `cheap` again and compares (exit code 77 where the data is missing)

Run it in the project's folder. `revisit` is $REVISIT. DATA may be town:SEED, a small drive that is simulated for the command. A row
replaces earlier ones of its drive, name, keyframes and perturbation.
"""

import argparse
import fcntl
import json
import os
import platform
import re
import shlex
import subprocess
import sys
import tempfile
from pathlib import Path

from loop_lines import run

ROOT = Path(__file__).resolve().parents[1]
DATA = ROOT / 'docs/data'
IDENTITY = ('drive', 'name', 'keyframes', 'perturbation')
SKIPPED = 77


def is_of(row, asked):
    return all(row.get(key) == asked.get(key) for key in IDENTITY)


def keep(file, row):
    """Replaces or appends a row. Safe for concurrent processes."""
    with open(file, 'a+') as opened:
        fcntl.flock(opened, fcntl.LOCK_EX)
        opened.seek(0)
        text = opened.read()
        rows = json.loads(text) if text else []
        place = next((i for i, known in enumerate(rows) if is_of(known, row)), len(rows))
        marks = {key: known[key] for known in rows[place:place + 1] for key in ('cheap', 'remark') if key in known}
        rows[place:place + 1] = [marks | row]
        opened.truncate(0)
        opened.write('[\n' + ',\n'.join(json.dumps(known, ensure_ascii=False) for known in rows) + '\n]\n')


def origin():
    def of_git(*words):
        return subprocess.run(['git', '-C', ROOT, *words], capture_output=True, text=True).stdout.strip()
    model = re.search(r'model name\s*:\s*(.*)', Path('/proc/cpuinfo').read_text())
    changed = '+' if of_git('status', '--porcelain', '--untracked-files=no', '--', '.', ':!docs/data') else ''
    return {'commit': of_git('rev-parse', '--short=10', 'HEAD') + changed,
            'machine': f'{model[1] if model else platform.processor()}, {platform.system()} {platform.machine()}'}


def figures(metrics):
    """Columns of a row from a task of run.json."""
    def rounded(value):
        return None if value is None else round(float(value), 4)
    row = {'perturbation': metrics['protocol']} if 'self' in metrics else {}
    row |= {'queries': metrics['n_queries'], 'with_place': metrics['n_positives'], 'ap': rounded(metrics.get('average_precision'))}
    if 'self' not in metrics:
        row['ap_interval'] = [rounded(end) for end in metrics.get('average_precision_ci', ())] or None  # None: a single block
        row |= {key: metrics.get(f'bootstrap_{key}') for key in ('blocks', 'positive_blocks')}
        row['recall_at_precision_1'] = rounded(metrics.get('max_recall_at_precision_1'))
    row['recall_at_1'] = rounded(metrics.get('recall_at_1'))
    if 'loops' in metrics:
        row |= {f'accepted_{label}': metrics['loops'].get(label, 0) for label in ('correct', 'incorrect')}
    return row


def row_of(drive, name, command):
    keyframes = {'keyframes': float(command[command.index('--keyframes') + 1].partition('=')[2])} if '--keyframes' in command else {}
    return {'drive': drive, 'name': name} | keyframes


def measured(drive, name, command):
    """Version of the program, and the rows of a command."""
    at = 2 if command[0] == 'revisit' else 1
    row = row_of(drive, name, command)
    with tempfile.TemporaryDirectory() as folder:
        data = command[at]
        if data.startswith('town:'):
            data = f'{folder}/town'
            run('simulate', '-o', data, '--sensor', 'vlp16', '--route', 'both', '--length', 300, '--every', 4, '--seed',
                command[at].partition(':')[2], '--quiet')
        elif not Path(data).exists():
            raise FileNotFoundError(data)
        if at == 2:
            done = run('eval', data, '--format', 'json', '--no-report', '--quiet', '-o', folder, *command[3:], stdout=subprocess.PIPE)
        else:
            done = subprocess.run([sys.executable, command[0], data, *command[2:]], check=True, stdout=subprocess.PIPE, text=True)
    found = json.loads(done.stdout)
    return found['info']['version'], [row | figures(task['metrics']) for task in found['tasks']]


def add(o, command):
    file, made, asked = DATA / f'{o.file}.json', origin(), row_of(o.drive, o.name, command)
    if o.missing and file.exists() and any(is_of(known | {'perturbation': None}, asked) for known in json.loads(file.read_text())):
        return
    version, rows = measured(o.drive, o.name, command)
    for row in rows:
        print(json.dumps(row), flush=True)
        keep(file, row | {'version': version} | made | ({'cheap': True} if o.cheap else {}) | {'command': shlex.join(command)})


def difference(row):
    """The first difference of a row measured again, or None."""
    found = next((found for found in measured(row['drive'], row['name'], shlex.split(row['command']))[1] if is_of(found, row)), None)
    if not found:
        return 'not measured by its command'
    return next((f'{key} is {row[key]} in the file, {value} now' for key, value in found.items() if row[key] != value), None)


def rerun_cheap_rows():
    code = 0
    for file in sorted(DATA.glob('*.json')):
        cheap = [row for row in json.loads(file.read_text()) if row.get('cheap')]
        if not cheap:
            print(f'{file.name}: no row is marked "cheap"')
            code = 1
        for row in cheap:
            try:
                fault = difference(row)
            except FileNotFoundError as error:
                print(f'{file.name}: {error} is missing')
                code = code or SKIPPED
                continue
            print(f'{file.name}: {row["drive"]}, {row["name"]}: {fault or "as in the file"}', flush=True)
            code = 1 if fault else code
    return code


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('file', nargs='?', help='docs/data/FILE.json')
    parser.add_argument('drive', nargs='?')
    parser.add_argument('name', nargs='?', help='of the method')
    parser.add_argument('--missing', action='store_true', help='do nothing if FILE has a row of this command')
    parser.add_argument('--cheap', action='store_true', help='mark the rows to be run again by the test documents.rows')
    parser.add_argument('--rerun', action='store_true')
    end = sys.argv.index('--') if '--' in sys.argv else len(sys.argv)
    o = parser.parse_args(sys.argv[1:end])
    os.chdir(ROOT)
    return rerun_cheap_rows() if o.rerun else add(o, sys.argv[end + 1:])


if __name__ == '__main__':
    sys.exit(main())
