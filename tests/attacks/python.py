#!/usr/bin/env python3
"""Attacks the Python package and the commands: arrays, lifetimes, threads, untrusted files, and surroundings.

Each case is a child process with a time-out and a memory limit. A fault: death by a signal, a hang, memory far beyond the
input, an error of a type outside of revisit.errors (except plain TypeError or ValueError), a wrong answer, a traceback.
Needs numpy, the package (PYTHONPATH) and the program (REVISIT_PROGRAM). Without rosbags, velodyne-decoder or, for
`converters`, the packages of tests/weights_conversion/requirements.txt, it skips their cases.
"""

import os
import resource
import sys
import tempfile
import traceback
from pathlib import Path
from typing import NamedTuple

import arrays
import memory
import strangers
import surroundings
from harness import MEGA, Fault, Skipped, in_child, parser_for, seeded, work_through

EXAMPLES = """\
examples:
  export PYTHONPATH=$PWD/build/dev/python REVISIT_PROGRAM=$PWD/build/dev/tools/revisit
  build/venv/bin/python tests/attacks/python.py arrays lifetimes threads
  build/dev/conversion_venv/bin/python tests/attacks/python.py converters --rounds 3 --seed 100
  build/venv/bin/python tests/attacks/python.py recordings --case 'mcap: damaged 7' --seed 4 -v    # one case again
"""
SECTIONS = {'arrays': arrays.cases, 'lifetimes': memory.lifetimes, 'threads': memory.threads, 'recordings': strangers.recordings,
            'converters': strangers.converters, 'environment': surroundings.cases}


def is_typed(error) -> bool:
    from revisit.errors import Error
    if isinstance(error, (Error, MemoryError)):  # numpy's MemoryError names the array
        return True
    return isinstance(error, (TypeError, ValueError)) and len(str(error)) > 8


class Answer(NamedTuple):
    verdict: str
    """refused, answered, skipped or fault"""
    said: str
    grown: int = 0
    """[MB], of the child without its own children"""


def answer_of(work, rng, folder) -> Answer:
    try:
        work(rng, folder)
        return Answer('answered', '')
    except Fault as error:
        return Answer('fault', f'wrong: {error}')
    except ImportError as error:
        return Answer('skipped', str(error))
    except BaseException as error:
        if is_typed(error):
            return Answer('refused', f'{type(error).__name__}: {error}')
        return Answer('fault', f'{type(error).__name__}: {error}\n{traceback.format_exc(limit=-3)}')


def of_child(case, seed, memory) -> Answer:
    with tempfile.TemporaryDirectory(prefix='attack-') as folder:
        size = int(Path('/proc/self/statm').read_text().split()[0]) * resource.getpagesize()
        before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        resource.setrlimit(resource.RLIMIT_AS, (size + memory * MEGA,) * 2)
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        answer = answer_of(case.work, seeded(seed, case.name), Path(folder))
    grown = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) // 1024
    return answer._replace(said=answer.said[:2000], grown=grown)


def attack(make_cases, section):
    o = section.arguments
    for seed in range(o.seed, o.seed + o.rounds):
        try:
            cases = [case for case in make_cases() if o.case in case.name]
        except ImportError as error:
            raise Skipped(str(error)) from error
        for case in cases:
            with section.case(f'--case {case.name!r} --seed {seed}') as outcome:
                answer = Answer(*in_child(lambda: of_child(case, seed, o.memory), o.timeout))  # noqa: B023  called at once
                if answer.verdict == 'fault':
                    raise Fault(answer.said)
                if answer.grown > case.grown:
                    raise Fault(f'took {answer.grown} MB ({answer.verdict}: {answer.said})')
                if answer.verdict == 'skipped':
                    raise Skipped(answer.said)
                outcome.refused, outcome.said = answer.verdict == 'refused', answer.said


def main():
    parser = parser_for(SECTIONS, __doc__, EXAMPLES)
    parser.add_argument('--rounds', type=int, default=1, help='with the seeds that follow: only cases that use one differ')
    parser.add_argument('--case', default='', metavar='TEXT', help='only cases whose names hold this')
    parser.add_argument('--timeout', type=float, default=60, metavar='S', help='of a case (default %(default)g)')
    parser.add_argument('--memory', type=int, default=6000, metavar='MB', help='that a case may ask for (default %(default)s)')
    return work_through(SECTIONS, parser, parser.parse_args(), attack)


if __name__ == '__main__':
    sys.exit(main())
