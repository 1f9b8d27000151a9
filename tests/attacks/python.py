#!/usr/bin/env python3
"""Attacks the Python package and the commands: arrays, lifetimes, threads, files of strangers, and surroundings.

Each case is a child process with a time-out and a memory limit. A fault: death by a signal, no end, memory far beyond the
input, an error of no type of revisit.errors (nor a plain TypeError or ValueError), a wrong answer, a traceback of a command.
Needs numpy, the package (PYTHONPATH) and the program (REVISIT_PROGRAM); what else is missing is skipped: rosbags,
velodyne-decoder; for `converters` what tests/weights_conversion/requirements.txt names.
"""

import arrays
import harness
import memory
import strangers
import surroundings

EXAMPLES = """\
examples:
  export PYTHONPATH=build/dev/python REVISIT_PROGRAM=build/dev/tools/revisit
  build/venv/bin/python tests/attacks/python.py arrays lifetimes threads
  build/dev/conversion_venv/bin/python tests/attacks/python.py converters --rounds 3 --seed 100
  build/venv/bin/python tests/attacks/python.py recordings --case 'mcap: damaged 7' --seed 4 -v    # one case again
"""
SECTIONS = {'arrays': arrays.cases, 'lifetimes': memory.lifetimes, 'threads': memory.threads, 'recordings': strangers.recordings,
            'converters': strangers.converters, 'environment': surroundings.cases}

if __name__ == '__main__':
    harness.run(SECTIONS, __doc__, EXAMPLES)
