#!/usr/bin/env python3
"""Changes the code in small ways, one at a time, and checks whether the tests of the changed file fail.

  tests/mutants/mutants.py                       12 changes a file of files.toml, on two copies of the tree
  tests/mutants/mutants.py --files fuse --each 60
  tests/mutants/mutants.py --report              results until now: killed, survived, by file

A mutant is a swapped comparison or sign, a number plus one, min for max, a removed statement or negation. Mutants that do not
compile are not counted. A mutant whose tests pass survived: it needs a test, or an entry in accepted.toml with the reason why
it is equivalent. The copies are build/mutants/0, 1, ... with a developer build each, and are used again. Each result is
appended to build/mutants/results.jsonl, so that an interrupted run resumes.
Exit code 1: there are survivors without a reason.
"""

import argparse
import concurrent.futures
import json
import queue
import random
import re
import shutil
import subprocess
import sys
import threading
import time
import tomllib
from pathlib import Path

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
SECONDS = 120
"""Limit of a test's CPU time [s]; the clock limit is four times as long. Mutants that exceed it, or the memory limit, are killed."""
LIMITED = ['timeout', str(4 * SECONDS), 'prlimit', f'--cpu={SECONDS}', '--as=12000000000']

SWAPS = {' < ': ' <= ', ' <= ': ' < ', ' > ': ' >= ', ' >= ': ' > ', ' == ': ' != ', ' != ': ' == ', ' && ': ' || ',
         ' || ': ' && ', ' + ': ' - ', ' - ': ' + ', ' * ': ' / ', ' / ': ' * ', ' += ': ' -= ', ' -= ': ' += ',
         'std::min': 'std::max', 'std::max': 'std::min', 'true': 'false', 'false': 'true'}
SWAPPED = re.compile('|'.join(re.escape(s) if not s.isalpha() else rf'\b{s}\b' for s in sorted(SWAPS, key=len, reverse=True)))
NUMBER = re.compile(r'(?<![\w.<])\d+(?![\w.>])')
NEGATION = re.compile(r'(?<=[( ])!(?=[\w(])')
STATEMENT = re.compile(r'^ +(?!return|throw|using|const|auto|if|for|else|case|break|static|constexpr)[\w.\->\[\]()*:]+'
                       r'( [-+*]?= .*|\(.*\));$')
NOT_CODE = re.compile(r'//[^\n]*|"(?:\\.|[^"\\\n])*"|\'(?:\\.|[^\'\\])\'|^#[^\n]*|static_assert[^\n]*|R"(\w*)\(.*?\)\1"', re.M | re.S)


def mutants_of(text):
    """Yields (begin, end, replacement), in the order of the text."""
    # Keeps the length, so that positions stay.
    code = NOT_CODE.sub(lambda found: re.sub(r'[^\n]', '"', found.group()), text)
    found = [(m.start(), m.end(), SWAPS[m.group()]) for m in SWAPPED.finditer(code)]
    found += [(m.start(), m.end(), str(int(m.group()) + 1)) for m in NUMBER.finditer(code)]
    found += [(m.start(), m.end(), '') for m in NEGATION.finditer(code)]
    at = 0
    for line in code.split('\n'):
        if STATEMENT.match(line):
            found.append((at + len(line) - len(line.lstrip()), at + len(line), ';'))
        at += len(line) + 1
    return sorted(found)


def shown(file, text, mutant):
    """Returns the position, the original line, and the changed line."""
    begin, end, instead = mutant
    first, last = text.rfind('\n', 0, begin) + 1, text.find('\n', end)
    return {'file': file, 'line': text.count('\n', 0, begin) + 1, 'before': text[first:last].strip(),
            'after': (text[first:begin] + instead + text[end:last]).strip()}


def key_of(shown_mutant):
    """Identifies a mutant independently of its line number."""
    return '{file}: {before} -> {after}'.format_map(shown_mutant)


def run(command, log, **options):
    """Returns whether it succeeded."""
    with open(log, 'w') as out:
        return subprocess.run([str(part) for part in command], stdout=out, stderr=subprocess.STDOUT, **options).returncode == 0


class Copy:
    """A copy of the tree with a developer build; its tests pass."""

    def __init__(self, folder, tested):
        self.root, self.build = folder, folder / 'build' / 'dev'
        self.log = folder / 'build' / 'mutants.log'
        self.build.mkdir(parents=True, exist_ok=True)
        files = subprocess.run(['git', 'ls-files', '-z'], cwd=ROOT, capture_output=True, text=True, check=True).stdout
        for file in filter(None, files.split('\0')):
            here, there = ROOT / file, folder / file
            # Unchanged files keep their time, so that they are not built again.
            if not there.exists() or there.read_bytes() != here.read_bytes():
                there.parent.mkdir(parents=True, exist_ok=True)
                shutil.copy(here, there)
        self.need(run(['cmake', '--preset', 'dev', '-DREVISIT_PYTHON=OFF', '-DREVISIT_PCL=OFF', '-DREVISIT_WERROR=OFF'], self.log,
                      cwd=folder))
        for target, tests in tested:  # failing tests would kill every mutant
            self.need(self.outcome_of(target, tests) == 'survived')

    def need(self, done):
        if not done:
            sys.exit(f'{self.log}: failed without a mutant:\n{self.log.read_text()[-3000:]}')

    def outcome_of(self, target, tests):
        """'killed', 'survived' or 'no build'."""
        if not run(['cmake', '--build', self.build, '--target', target], self.log):
            return 'no build'
        passed = run([*LIMITED, 'ctest', '--test-dir', self.build, '-R', f'^({tests})$', '--no-tests=error', '--stop-on-failure'],
                     self.log)
        return 'survived' if passed else 'killed'

    def try_mutant(self, job):
        file, text, (begin, end, instead), entry = job
        try:
            (self.root / file).write_text(text[:begin] + instead + text[end:])
            return self.outcome_of(entry['target'], entry['tests'])
        finally:
            (self.root / file).write_text(text)


def report(results, accepted):
    rows, survivors = {}, []
    for result in results:
        row = rows.setdefault(result['file'], {'killed': 0, 'survived': 0, 'no build': 0, 'accepted': 0})
        there = key_of(result) in accepted and result['outcome'] == 'survived'
        row['accepted' if there else result['outcome']] += 1
        if result['outcome'] == 'survived' and not there:
            survivors.append(result)
    width = max(map(len, rows), default=10) + 2
    print(f'{"file":{width}}{"mutants":>8}{"killed":>8}{"accepted":>9}{"survived":>9}')
    total = {name: sum(row[name] for row in rows.values()) for name in ('killed', 'accepted', 'survived')}
    for name, row in [*rows.items(), ('all', total)]:
        print(f'{name:{width}}{row["killed"] + row["accepted"] + row["survived"]:8}{row["killed"]:8}{row["accepted"]:9}'
              f'{row["survived"]:9}')
    for result in survivors:
        print(f'\n{result["file"]}:{result["line"]}\n  - {result["before"]}\n  + {result["after"]}')
    return survivors


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--files', default='', help='regular expression of the paths to change')
    parser.add_argument('--each', type=int, default=12, help='mutants of a file, chosen at random (default %(default)s)')
    parser.add_argument('--seed', type=int, default=1, help='of the choice (default %(default)s)')
    parser.add_argument('--copies', type=int, default=2, help='trees that work at once (default %(default)s)')
    parser.add_argument('--again', action='store_true', help='the survivors once more, as when tests were added')
    parser.add_argument('--report', action='store_true', help='run nothing')
    o = parser.parse_args()
    folder = ROOT / 'build' / 'mutants'
    folder.mkdir(parents=True, exist_ok=True)
    log = folder / 'results.jsonl'
    results = {key_of(r): r for r in map(json.loads, log.read_text().splitlines())} if log.exists() else {}
    accepted = tomllib.loads((HERE / 'accepted.toml').read_text())
    jobs, there = queue.Queue(), set()

    def survived(key):
        return key in results and results[key]['outcome'] == 'survived' and key not in accepted

    for entry in tomllib.loads((HERE / 'files.toml').read_text())['library']:
        for file in entry['files']:
            if not re.search(o.files, file):
                continue
            text = (ROOT / file).read_text()
            found = mutants_of(text)
            random.Random(f'{o.seed} {file}').shuffle(found)
            for i, mutant in enumerate(found):
                key = key_of(shown(file, text, mutant))
                there.add(key)
                if (i < o.each and key not in results) or (o.again and survived(key)):
                    jobs.put((file, text, mutant, entry))
    count, begun, lock = jobs.qsize(), time.monotonic(), threading.Lock()

    def work(number):
        copy = Copy(folder / str(number), sorted({(entry['target'], entry['tests']) for _, _, _, entry in list(jobs.queue)}))
        while True:
            try:
                job = jobs.get_nowait()
            except queue.Empty:
                return
            file, text, mutant, _ = job
            result = {**shown(file, text, mutant), 'outcome': copy.try_mutant(job)}
            with lock, open(log, 'a') as out:
                results[key_of(result)] = result
                out.write(json.dumps(result) + '\n')
                done = count - jobs.qsize()
                left = (time.monotonic() - begun) / done * (count - done)
                print(f'{done}/{count}, {left / 60:.0f} min left: {result["outcome"]:9} {file}:{result["line"]}', file=sys.stderr)

    if not o.report and count:
        with concurrent.futures.ThreadPoolExecutor(o.copies) as pool:
            for future in [pool.submit(work, number) for number in range(o.copies)]:
                future.result()
    # Skips results whose line has changed since.
    return 1 if report([result for key, result in results.items() if key in there], accepted) else 0


if __name__ == '__main__':
    sys.exit(main())
