"""Runs cases in a child process, so that a crash or a hang is a fault of one case."""

import json
import os
import re
import resource
import select
import signal
import time

GIGA = 1 << 30
# Messages of programs that did not expect their input.
INTERNAL = re.compile(r'std::|bad_alloc|basic_string|_M_|Assertion|terminate called|vector::|Sanitizer|runtime error|Exception ignored')


class Fault(Exception):
    """A wrong answer of a case."""


def is_typed(error) -> bool:
    from revisit.errors import Error
    if isinstance(error, (Error, MemoryError)):
        return True
    return isinstance(error, (TypeError, ValueError)) and len(str(error)) > 8


def fault_of(work) -> str:
    """'' if `work` returns, or raises an error of revisit or a plain TypeError or ValueError."""
    try:
        work()
    except Fault as fault:
        return str(fault)
    except ImportError:  # there is no such case
        pass
    except BaseException as error:
        if not is_typed(error) or INTERNAL.search(str(error)):
            return f'{type(error).__name__}: {error}'
    return ''


def faults_of(cases, timeout=120) -> list[str]:
    """Runs (name, work) of each case, in order, in one child that may take 2 GB more. Returns 'NAME: FAULT'."""
    out, into = os.pipe()
    errors, now = os.memfd_create('errors'), os.memfd_create('now')
    child = os.fork()
    if child == 0:
        os.close(out)
        os.dup2(errors, 2)
        size = int(open('/proc/self/statm').read().split()[0]) * resource.getpagesize()
        if 'ASAN_OPTIONS' not in os.environ:
            resource.setrlimit(resource.RLIMIT_AS, (size + 2 * GIGA,) * 2)
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        faults = []
        for name, work in cases:
            os.ftruncate(now, 0)
            os.pwrite(now, name.encode(), 0)
            if fault := fault_of(work):
                faults.append(f'{name}: {fault}')
        os.write(into, json.dumps(faults[:20]).encode())
        os._exit(0)
    os.close(into)
    end = time.monotonic() + timeout
    ready = select.select([out], [], [], max(0, end - time.monotonic()))[0]
    if not ready:
        os.kill(child, signal.SIGKILL)
    text = os.read(out, 1 << 20) if ready else b''
    status = os.waitpid(child, 0)[1]
    name, said = os.pread(now, 1000, 0).decode(), os.pread(errors, 2000, 0).decode(errors='backslashreplace')
    for file in (out, errors, now):
        os.close(file)
    if not ready:
        return [f'{name}: no end within {timeout} s']
    if os.WIFSIGNALED(status) or not text:
        return [f'{name}: death by signal {os.WTERMSIG(status)}: {said}']
    return json.loads(text) + ([f'internal message: {said}'] if INTERNAL.search(said) else [])
