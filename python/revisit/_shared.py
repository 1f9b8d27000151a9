"""Threads, messages and scripts of the interfaces of pycaffe and cv2.dnn."""

import contextlib
import os
import runpy
import sys

from .errors import Error

_threads = None


def threads() -> int:
    """Returns the threads of a forward pass: set_threads(), else OMP_NUM_THREADS, else the CPUs of this process."""
    if _threads is not None:
        return _threads
    first = os.environ.get('OMP_NUM_THREADS', '').split(',')[0].strip()
    if first.isdigit() and int(first) > 0:
        return int(first)
    return len(os.sched_getaffinity(0))


def set_threads(number: int | None) -> None:
    """Sets the number of threads of later forward passes; None: the default. Results do not depend on it."""
    global _threads
    if number is not None and int(number) < 1:
        raise ValueError(f'expected at least one thread, found {number}')
    _threads = None if number is None else int(number)


@contextlib.contextmanager
def named(prototxt, weights=''):
    """Inserts file names into messages of the engine, which reads from memory."""
    try:
        yield
    except Error as error:
        message = str(error).replace('<prototxt>', prototxt).replace('<weights>', weights)
        raise type(error)(message) from None


def run_script(usage):
    """Runs the script that the command line names, with the arguments behind it."""
    if len(sys.argv) < 2 or sys.argv[1].startswith('-'):
        sys.exit(usage)
    del sys.argv[0]
    sys.path[0] = os.path.dirname(os.path.realpath(sys.argv[0]))
    runpy.run_path(sys.argv[0], run_name='__main__')
