#!/usr/bin/env python3
"""Support of the public nets of public_nets.csv by `revisit net inspect`, with reasons for rejection.

  sweep_nets.py build/dev/tools/revisit /tmp/nets                 # downloads missing files; prints tables
  sweep_nets.py build/dev/tools/revisit /tmp/nets --csv now.csv   # also writes one line per net

The exit code is 1 if a net crashes the program, takes longer than a minute, or has another checksum.
"""

import argparse
import collections
import csv
import hashlib
import re
import subprocess
import sys
import urllib.error
import urllib.request
from pathlib import Path

NETS = Path(__file__).with_name('public_nets.csv')
SECONDS = 60
REASONS = (  # patterns for the last line of the program's output
    ('type', r"layer type '([^']*)' is not supported"),
    ('type', r"layers of the type '(Python)' run in"),
    ('field', r"unknown field '([^']*)' in \w+"),
    ('value', r"unknown value '([^']*)' for \w+"),
    ('shape', r'gives no shape for the input ()'),
    ('layer', r"layer '[^']*'(?: \(\w+\))?: (.{,80})"),
    ('text', r':\d+:\d+: (.{,80})'))


def content(net, folder):
    """Returns the file in the folder; downloads it from GitHub if missing."""
    file = folder / net['repository'].replace('/', '+') / net['path']
    if not file.exists():
        address = f'https://raw.githubusercontent.com/{net["repository"]}/{net["commit"]}/{urllib.request.quote(net["path"])}'
        with urllib.request.urlopen(address, timeout=SECONDS) as answer:
            text = answer.read()
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_bytes(text)
    if hashlib.sha256(file.read_bytes()).hexdigest() != net['sha256']:
        raise OSError(f'{file}: the checksum differs from {NETS.name}')
    return file


def outcome(program, file):
    """Returns (kind, detail) of the program's output: kind 'accepted', 'crash' or 'hang' (faults), or a reason for rejection."""
    try:
        done = subprocess.run([program, 'net', 'inspect', file], capture_output=True, text=True, errors='replace', timeout=SECONDS)
    except subprocess.TimeoutExpired:
        return 'hang', ''
    if done.returncode == 0:
        return 'accepted', ''
    if done.returncode < 0 or not done.stderr.strip():
        return 'crash', str(done.returncode)
    last = done.stderr.strip().splitlines()[-1]
    found = ((kind, re.search(pattern, last)) for kind, pattern in REASONS)
    return next(((kind, match[1]) for kind, match in found if match), ('other', last[:80]))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('program')
    parser.add_argument('folder', type=Path)
    parser.add_argument('--csv', type=Path, metavar='FILE')
    o = parser.parse_args()
    lines, faults = [], 0
    for net in csv.DictReader(NETS.open(encoding='utf-8')):
        try:
            kind, detail = outcome(o.program, content(net, o.folder))
        except (OSError, urllib.error.URLError) as error:
            kind, detail = 'missing', str(error)
        if kind in ('crash', 'hang', 'missing'):
            faults += 1
            print(f'{net["repository"]} {net["path"]}: {kind} {detail}', file=sys.stderr)
        lines.append({'repository': net['repository'], 'path': net['path'], 'kind': kind, 'detail': detail})
    if o.csv:
        with o.csv.open('w', newline='', encoding='utf-8') as out:
            table = csv.DictWriter(out, lines[0])
            table.writeheader()
            table.writerows(lines)
    accepted = sum(line['kind'] == 'accepted' for line in lines)
    print(f'{accepted} of {len(lines)} nets of {len({line["repository"] for line in lines})} repositories are accepted '
          f'({100 * accepted / len(lines):.1f} %)\n\n| reason | what | nets | repositories |\n|---|---|---|---|')
    refused = collections.defaultdict(list)
    for line in lines:
        if line['kind'] != 'accepted':
            refused[line['kind'], line['detail']].append(line['repository'])
    for (kind, detail), repositories in sorted(refused.items(), key=lambda entry: -len(entry[1])):
        print(f'| {kind} | {detail} | {len(repositories)} | {len(set(repositories))} |')
    return 1 if faults else 0


if __name__ == '__main__':
    sys.exit(main())
