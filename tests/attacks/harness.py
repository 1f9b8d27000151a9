"""Shared by the attacks: options, programs, child processes, fault criteria, corruption, the table."""

import argparse
import contextlib
import hashlib
import io
import json
import os
import random
import re
import resource
import select
import shutil
import signal
import subprocess
import sys
import time
import traceback
from pathlib import Path
from typing import Callable, NamedTuple

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE.parent / folder) for folder in ('python', 'weights_conversion')] + [str(HERE.parents[1] / 'weights_conversion')]
MEGA = 1 << 20
TIMEOUT = 60  # [s]
CODES = (0, 1, 2, 3, 4, 5, 6)
# Messages of programs that did not expect their input.
INTERNAL = re.compile(
    r'std::|bad_alloc|basic_string|_M_|Assertion|terminate called|vector::|map::at|stoi|stod|SIGSEGV|'
    r'Sanitizer|runtime error|pqxx::|not an error|Traceback|Exception ignored', re.I)


class Fault(Exception):
    """A violation by the attacked code."""


class Skipped(Exception):
    """A requirement of a case or section is missing."""


class Case(NamedTuple):
    """Case of python.py; sections of maps.py create theirs as they run."""
    name: str
    work: Callable
    """work(rng, folder) in a child: returns when answered, raises what the project raises, Fault for a wrong answer."""
    grown: int = 400
    """[MB] by which the child may grow: far above what these small inputs need."""


class Section:
    def __init__(self, name, arguments):
        self.name, self.arguments, self.faults, self.skipped = name, arguments, [], ''
        self.tried = self.refused = self.answered = 0

    @contextlib.contextmanager
    def case(self, what):
        """`what` names the case for repetition. The body reports rejection by setting .refused."""
        outcome = Outcome()
        try:
            yield outcome
            verdict = 'refused' if outcome.refused else 'answered'
        except Skipped as reason:
            self.skipped, verdict = str(reason), 'skipped'
        except Fault as fault:
            self.faults.append(f'{what}: {fault}')
            print(f'FAULT {self.name}: {what}: {fault}', flush=True)
            verdict = ''
        self.tried += verdict != 'skipped'
        self.refused += verdict == 'refused'
        self.answered += verdict == 'answered'
        if verdict and self.arguments.verbose:
            print(f'{self.name}: {what}: {verdict} {outcome.said[:300]}', flush=True)


class Outcome:
    refused = False
    said = ''


class Result:
    """Result of a program that exited by itself."""

    def __init__(self, code, out, err):
        self.code, self.out, self.err = code, out, err
        self.text = out + err


def judge(code, out, err, codes=CODES, silent=False):
    """`silent`: may fail without a message."""
    text = ((out or b'') + (err or b'')).decode(errors='backslashreplace')
    if code < 0 and code not in codes:
        raise Fault(f'death by signal {-code}: {text[-300:]}')
    if INTERNAL.search(text):
        raise Fault(f'internal message, code {code}: {text[-700:]}')
    if code not in codes:
        raise Fault(f'exit code {code}, expected one of {codes}: {text[-400:]}')
    if code in (1, 2, 3, 4) and not silent and not err.strip():
        raise Fault(f'exit code {code} without a message')
    return Result(code, *((part or b'').decode(errors='backslashreplace') for part in (out, err)))


def start(program, arguments, limits=(), user=None, **options):
    def prepare():
        for what, value in limits:
            resource.setrlimit(what, (value, value))

    streams = {'stdin': subprocess.DEVNULL, 'stdout': subprocess.PIPE, 'stderr': subprocess.PIPE, 'preexec_fn': prepare}
    return subprocess.Popen([os.fsencode(word) for word in (program, *arguments)], user=user, extra_groups=[] if user else None,
                            **streams | options)


def end_of(process, timeout=TIMEOUT):
    """Waits for the exit; returns the remaining (stdout, stderr)."""
    try:
        return process.communicate(timeout=timeout)
    except subprocess.TimeoutExpired:
        process.kill()
        raise Fault(f'no end within {timeout} s: {process.communicate()}'[-400:]) from None


def run(program, arguments, timeout=TIMEOUT, codes=CODES, silent=False, **options):
    process = start(program, arguments, **options)
    out, err = end_of(process, timeout)
    return judge(process.returncode, out, err, codes, silent)


def in_child(work, timeout=TIMEOUT):
    out, into = os.pipe()
    errors = os.memfd_create('errors')
    child = os.fork()
    if child == 0:
        os.close(out)
        os.dup2(errors, 2)
        try:
            answer = json.dumps({'answer': work()})
        except Fault as fault:
            answer = json.dumps({'fault': str(fault)})
        except BaseException:
            answer = json.dumps({'fault': traceback.format_exc(limit=4)[-500:]})
        with os.fdopen(into, 'w') as pipe:
            pipe.write(answer)
        os._exit(0)
    os.close(into)
    text, end = b'', time.monotonic() + timeout
    while True:
        if not select.select([out], [], [], max(0, end - time.monotonic()))[0]:
            os.kill(child, signal.SIGKILL)
            os.waitpid(child, 0)
            os.close(out)
            os.close(errors)
            raise Fault(f'no end within {timeout} s')
        part = os.read(out, 1 << 20)
        if not part:
            break
        text += part
    os.close(out)
    status = os.waitpid(child, 0)[1]
    said = os.pread(errors, 2000, 0).decode(errors='backslashreplace')
    os.close(errors)
    if os.WIFSIGNALED(status):
        raise Fault(f'death by signal {os.WTERMSIG(status)}: {said}')
    if INTERNAL.search(said):
        raise Fault(f'internal message: {said}')
    answer = json.loads(text)
    if 'fault' in answer:
        raise Fault(answer['fault'])
    return answer['answer']


def digest(place):
    """Covers everything of a place except its id."""
    text = hashlib.sha256(repr((place.drive, place.frame, place.time)).encode())
    for part in (place.pose, place.descriptor, place.feature):
        text.update(b'-' if part is None else part.tobytes())
    return text.hexdigest()[:24]


def message_of(error):
    import revisit
    text = str(error)
    if not isinstance(error, (revisit.Error, MemoryError)):
        raise Fault(f'{type(error).__name__}: {text}')
    if INTERNAL.search(text) or not text:
        raise Fault(f'internal message: {text}')
    return text


def accepted(work):
    def checked(rng, folder):
        try:
            work(rng, folder)
        except (Fault, ImportError):
            raise
        except Exception as error:
            raise Fault(f'what is right is refused: {error}') from error
    return checked


def damaged(rng, content) -> bytes:
    """Returns bytes truncated, flipped, with hostile sizes, moved or repeated."""
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
    content = file.read_bytes()
    for _ in range(rng.choice([1, 1, 2, 5])):
        content = damaged(rng, content)
    file.write_bytes(content)


def capture(main, words):
    """Returns exit code and output of a Python command. Faults: escaping exceptions, and errors of foreign types."""
    out = io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(out):
        try:
            code = main([str(word) for word in words])
        except SystemExit as end:
            code = end.code
    return code, out.getvalue()


def seeded(seed, *parts):
    return random.Random(':'.join(map(str, (seed, *parts))))


def fresh(folder):
    shutil.rmtree(folder, ignore_errors=True)
    Path(folder).mkdir(parents=True)
    return Path(folder)


def print_table(sections):
    print(f'\n{"section":<14}{"tried":>7}{"refused":>9}{"answered":>10}{"faults":>8}')
    for section in sections:
        print(f'{section.name:<14}{section.tried:>7}{section.refused:>9}{section.answered:>10}{len(section.faults):>8}'
              + (f'  skipped: {section.skipped}' if section.skipped else ''))
    for section in sections:
        for fault in section.faults[:20]:
            print(f'{section.name}: {fault}')
    sys.stdout.flush()


def parser_for(sections, description, examples):
    parser = argparse.ArgumentParser(description=description, epilog=examples, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('sections', nargs='*', metavar='SECTION', help=f'of {", ".join(sections)} (default: all)')
    parser.add_argument('--seed', type=int, default=1, help='(default %(default)s)')
    parser.add_argument('-v', '--verbose', action='store_true', help='a line for each case')
    return parser


def work_through(sections, parser, arguments, attack):
    """Runs attack(requirements, Section) for each selected section, prints the table, returns the exit code."""
    if unknown := set(arguments.sections) - set(sections):
        parser.error(f'no section {", ".join(sorted(unknown))}; there are {", ".join(sections)}')
    done = []
    for name in arguments.sections or sections:
        section, begin = Section(name, arguments), time.monotonic()
        done.append(section)
        try:
            attack(sections[name], section)
        except Skipped as reason:
            section.skipped = str(reason)
        print(f'{name}: {section.tried} in {time.monotonic() - begin:.0f} s, {len(section.faults)} faults', flush=True)
    print_table(done)
    if not any(section.tried for section in done):
        sys.exit('no case ran')
    return 1 if any(section.faults for section in done) else 0
