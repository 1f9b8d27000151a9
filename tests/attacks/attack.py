"""What the attacks share: running the program, work in a child of its own, judging, counting."""

import contextlib
import hashlib
import json
import os
import random
import re
import resource
import select
import shutil
import signal
import struct
import subprocess
import sys
import time
import traceback
from pathlib import Path

# What only a program that did not expect its input says.
INTERNAL = re.compile(
    r'std::|bad_alloc|basic_string|_M_|Assertion|terminate called|vector::|map::at|stoi|stod|SIGSEGV|'
    r'Sanitizer|runtime error|pqxx::|not an error|Traceback', re.I)
TIMEOUT = 60  # [s]


class Fault(Exception):
    """What was attacked did what it must not do."""


class Section:
    """Counts what one section has tried."""

    def __init__(self, name):
        self.name, self.tried, self.refused, self.answered, self.faults = name, 0, 0, 0, []
        self.skipped = ''

    @contextlib.contextmanager
    def case(self, what):
        """`what` names the case so that it can be repeated. The body returns by setting .refused."""
        self.tried += 1
        outcome = Outcome()
        try:
            yield outcome
        except Fault as fault:
            self.faults.append(f'{what}: {fault}')
            print(f'FAULT {self.name}: {what}: {fault}', flush=True)
            return
        if outcome.refused:
            self.refused += 1
        else:
            self.answered += 1


class Outcome:
    refused = False


class Result:
    """Of a program that has ended by itself."""

    def __init__(self, code, out, err):
        self.code, self.out, self.err = code, out, err
        self.text = out + err


def judge(code, out, err, codes=(0, 1, 2, 3, 4, 5, 6)):
    text = (out + err).decode(errors='backslashreplace')
    if code < 0:
        raise Fault(f'death by signal {-code}: {text[-300:]}')
    if INTERNAL.search(text):
        raise Fault(f'internal message, code {code}: {text[-300:]}')
    if code not in codes:
        raise Fault(f'exit code {code}: {text[-300:]}')
    if code in (1, 2, 3, 4) and not err.strip():
        raise Fault(f'exit code {code} without a message')
    return Result(code, out.decode(errors='backslashreplace'), err.decode(errors='backslashreplace'))


def start(program, arguments, limits=(), user=None, **more):
    def prepare():
        for what, value in limits:
            resource.setrlimit(what, (value, value))

    return subprocess.Popen([os.fsencode(program), *map(os.fsencode, arguments)], stdin=subprocess.DEVNULL,
                            stdout=subprocess.PIPE, stderr=subprocess.PIPE, preexec_fn=prepare, user=user,
                            extra_groups=[] if user else None, **more)


def end_of(process, timeout=TIMEOUT):
    """What it still says, (stdout, stderr), once it has ended by itself."""
    try:
        return process.communicate(timeout=timeout)
    except subprocess.TimeoutExpired:
        process.kill()
        raise Fault(f'no end within {timeout} s: {process.communicate()[1][-300:]}') from None


def run(program, arguments, timeout=TIMEOUT, codes=(0, 1, 2, 3, 4, 5, 6), **more):
    """Runs the program to its end and judges it."""
    process = start(program, arguments, **more)
    out, err = end_of(process, timeout)
    return judge(process.returncode, out, err, codes)


def in_child(work, timeout=TIMEOUT, memory=None):
    """What work() returns (JSON), computed in a process of its own."""
    out, into = os.pipe()
    errors = os.memfd_create('errors')
    child = os.fork()
    if child == 0:
        os.close(out)
        os.dup2(errors, 2)
        try:
            if memory:
                resource.setrlimit(resource.RLIMIT_AS, (memory, memory))
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
    """All there is of a place but its id."""
    text = hashlib.sha256(repr((place.drive, place.frame, place.time)).encode())
    for part in (place.pose, place.descriptor, place.feature):
        text.update(b'-' if part is None else part.tobytes())
    return text.hexdigest()[:24]


def message_of(error):
    """Of an error that revisit raises on purpose."""
    import revisit
    text = str(error)
    if not isinstance(error, (revisit.Error, MemoryError)):
        raise Fault(f'{type(error).__name__}: {text}')
    if INTERNAL.search(text) or not text:
        raise Fault(f'internal message: {text}')
    return text


class Checksum:
    """Of rows, as pipeline/maps/src/checksum.h has it: so that strangers' rows are believed."""

    def __init__(self):
        self.hash = 0xCBF29CE484222325

    def word(self, word):
        self.hash = (self.hash ^ word) * 0x100000001B3 & (1 << 64) - 1

    def number(self, value):
        self.word(value & 0xFFFFFFFF)
        self.word(value >> 32 & 0xFFFFFFFF)
        return self

    def bytes(self, text):
        self.number(len(text))
        for i in range(0, len(text), 4):
            self.word(int.from_bytes(text[i:i + 4], 'little'))
        return self

    @property
    def value(self):
        return struct.unpack('<q', struct.pack('<Q', self.hash))[0]


def print_table(sections):
    print(f'\n{"section":<12} {"tried":>7} {"refused":>8} {"answered":>9} {"faults":>7}')
    for section in sections:
        print(f'{section.name:<12} {section.tried:>7} {section.refused:>8} {section.answered:>9} '
              f'{len(section.faults):>7}' + (f'  skipped: {section.skipped}' if section.skipped else ''))
    for section in sections:
        for fault in section.faults[:20]:
            print(f'{section.name}: {fault}')
    sys.stdout.flush()


def seeded(seed, *parts):
    return random.Random(':'.join(map(str, (seed, *parts))))


def fresh(folder):
    """An empty folder at this path."""
    shutil.rmtree(folder, ignore_errors=True)
    Path(folder).mkdir(parents=True)
    return Path(folder)
