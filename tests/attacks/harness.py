"""What the attacks share: cases in child processes, and what counts as a fault."""

import argparse
import contextlib
import io
import os
import resource
import subprocess
import sys
import tempfile
import traceback
from collections import Counter
from pathlib import Path
from typing import Callable, NamedTuple

from attack import Fault, in_child, seeded

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE.parent / folder) for folder in ('python', 'weights_conversion')] + [str(HERE.parents[1] / 'weights_conversion')]
MEGA = 1 << 20
TRACEBACK = 'Traceback (most recent call last)'


class Case(NamedTuple):
    name: str
    work: Callable
    """work(rng, folder) in a child: returns when answered, raises what the project raises, Fault for a wrong answer."""
    grown: int = 400
    """[MB] by which the child may grow: far above what these small inputs need."""


class Result(NamedTuple):
    verdict: str
    """refused, answered, skipped or fault"""
    said: str
    grown: int = 0
    """[MB], of the child without its own children"""


def is_typed(error) -> bool:
    from revisit.errors import Error
    if isinstance(error, (Error, MemoryError)):  # numpy's MemoryError names the array
        return True
    return isinstance(error, (TypeError, ValueError)) and len(str(error)) > 8


def judged(work, rng, folder) -> Result:
    """What became of a case, as its child sees it."""
    try:
        work(rng, folder)
        return Result('answered', '')
    except Fault as error:
        return Result('fault', f'wrong: {error}')
    except ImportError as error:
        return Result('skipped', str(error))
    except BaseException as error:  # all that can come out
        if is_typed(error):
            return Result('refused', f'{type(error).__name__}: {error}')
        return Result('fault', f'{type(error).__name__}: {error}\n{traceback.format_exc(limit=-3)}')


def of_child(case, seed, memory) -> Result:
    with tempfile.TemporaryDirectory(prefix='attack-') as folder:
        size = int(Path('/proc/self/statm').read_text().split()[0]) * resource.getpagesize()
        before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        resource.setrlimit(resource.RLIMIT_AS, (size + memory * MEGA,) * 2)
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        result = judged(case.work, seeded(seed, case.name), Path(folder))
    grown = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) // 1024
    return Result(result.verdict, result.said[:2000], grown)


def run_case(case, seed, timeout, memory) -> Result:
    try:
        result = Result(*in_child(lambda: of_child(case, seed, memory), timeout))
    except Fault as fault:
        return Result('fault', str(fault))
    if result.verdict != 'fault' and result.grown > case.grown:
        return Result('fault', f'took {result.grown} MB ({result.verdict}: {result.said})')
    return result


def command(words, codes=(0, 1, 2, 3, 4, 5, 6), must_say=True, **options):
    """Runs a console command, which must end by itself with one of `codes`, without a traceback. Returns it."""
    options = {'stdout': subprocess.PIPE, 'stderr': subprocess.PIPE, 'stdin': subprocess.DEVNULL, 'timeout': 100} | options
    done = subprocess.run([os.fsencode(word) for word in words], **options)
    said = (done.stderr or b'') + (done.stdout or b'')
    if TRACEBACK.encode() in said or b'Exception ignored' in said:
        raise Fault(f'a traceback: {said[-700:].decode(errors="replace")}')
    if done.returncode not in codes:
        raise Fault(f'exit code {done.returncode}, expected one of {codes}: {said[-400:].decode(errors="replace")}')
    if must_say and done.returncode and options['stderr'] == subprocess.PIPE and not said.strip():
        raise Fault(f'exit code {done.returncode} without a word')
    return done


def damaged(rng, content) -> bytes:
    """Bytes cut, flipped, with hostile sizes, moved or repeated."""
    content = bytearray(content)
    if not content:
        return bytes(content)
    kind = rng.choice(['cut', 'flip', 'flip', 'size', 'size', 'zeros', 'move', 'repeat', 'digit'])
    at = rng.randrange(len(content))
    if rng.random() < 0.5:
        at = min(at, rng.randrange(600) % len(content))  # headers are at the beginning
    if kind == 'cut':
        return bytes(content[:at])
    if kind == 'flip':
        for _ in range(rng.choice([1, 1, 4, 30])):
            content[rng.randrange(max(0, at - 40), min(len(content), at + 40))] ^= 1 << rng.randrange(8)
    elif kind == 'size':
        hostile = rng.choice([b'\xff' * 4, b'\xff' * 8, b'\xff\xff\xff\x7f', b'\x00\x00\x00\x80', b'\x00\x00\x00\x40', b'\xff' * 7 + b'\x7f',
                              b'\x00\x00\x00\x00\x01\x00\x00\x00'])
        content[at:at + len(hostile)] = hostile
    elif kind == 'zeros':
        n = rng.choice([1, 4, 64])
        content[at:at + n] = bytes(n)
    elif kind == 'move':
        part = content[at:at + rng.randrange(1, 64)]
        del content[at:at + len(part)]
        to = rng.randrange(len(content) + 1)
        content[to:to] = part
    elif kind == 'repeat':
        content[at:at] = content[at:at + rng.randrange(1, 64)] * rng.randrange(1, 5)
    else:
        digits = [i for i, byte in enumerate(content) if 48 <= byte <= 57]
        if digits:
            i = rng.choice(digits)
            content[i:i + 1] = rng.choice([b'-1', b'99999999999999999999', b'nan', b'1e400', b'0', b'9' * 400])
    return bytes(content)


def damage(rng, file):
    """Writes damaged bytes in the place of a file's."""
    content = file.read_bytes()
    for _ in range(rng.choice([1, 1, 2, 5])):
        content = damaged(rng, content)
    file.write_bytes(content)


def capture(main, words):
    """Exit code and what a Python command said. Faults: what gets out of it, and errors of no type of the project's."""
    out = io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(out):
        try:
            code = main([str(word) for word in words])
        except SystemExit as end:
            code = end.code
    return code, out.getvalue()


def run(sections, description, examples):
    """The whole program: options, cases, the table."""
    parser = argparse.ArgumentParser(description=description, epilog=examples, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('section', nargs='*', help=f'of {", ".join(sections)} (default: all)')
    parser.add_argument('--seed', type=int, default=1, help='of the first round (default %(default)s)')
    parser.add_argument('--rounds', type=int, default=1, help='with the seeds that follow: only cases that use one differ')
    parser.add_argument('--case', default='', metavar='TEXT', help='only cases whose names hold this')
    parser.add_argument('--timeout', type=float, default=60, metavar='S', help='of a case (default %(default)g)')
    parser.add_argument('--memory', type=int, default=6000, metavar='MB', help='that a case may ask for (default %(default)s)')
    parser.add_argument('-v', '--verbose', action='store_true', help='a line for each case')
    o = parser.parse_args()
    if unknown := set(o.section) - set(sections):
        parser.error(f'no section {", ".join(sorted(unknown))}; there are {", ".join(sections)}')
    rows, faults = [], []
    for section in o.section or sections:
        counts = Counter()
        for seed in range(o.seed, o.seed + o.rounds):
            try:
                cases = [case for case in sections[section]() if o.case in case.name]
            except ImportError as error:
                print(f'{section}: skipped: {error}')
                break
            for case in cases:
                result = run_case(case, seed, o.timeout, o.memory)
                counts[result.verdict] += 1
                if result.verdict == 'fault':
                    faults.append((section, case.name))
                    print(f'FAULT {section} --case {case.name!r} --seed {seed}: {result.said}', flush=True)
                elif o.verbose:
                    print(f'{section} {case.name!r} --seed {seed}: {result.verdict} {result.said[:300]}', flush=True)
        rows.append((section, counts))
    print(f'{"section":14}{"cases":>8}{"refused":>9}{"answered":>10}{"skipped":>9}{"faults":>8}')
    for section, counts in rows:
        print(f'{section:14}{sum(counts.values()):8}{counts["refused"]:9}{counts["answered"]:10}{counts["skipped"]:9}{counts["fault"]:8}')
    if not any(counts['refused'] + counts['answered'] + counts['fault'] for _, counts in rows):
        sys.exit('no case ran')
    sys.exit(1 if faults else 0)
