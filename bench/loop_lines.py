"""Runs `revisit`, and reads the lines of `revisit loops`."""

import json
import os
import subprocess

import numpy as np


def run(*words, **options):
    """$REVISIT with these arguments."""
    return subprocess.run([os.environ.get('REVISIT', 'build/release/tools/revisit'), *map(str, words)], check=True, text=True, **options)


def lines_of(data, *words):
    """A dict for each scan of `data`, in order."""
    done = run('loops', data, '--all', '--format', 'jsonl', '--quiet', *words, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    return [json.loads(line) for line in done.stdout.splitlines()]


def pose_of(registered):
    """T_place_query of `registered` of a line."""
    x, y, z, w = (registered[key] for key in ('qx', 'qy', 'qz', 'qw'))
    pose = np.eye(4)
    pose[:3, :3] = [[1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
                    [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                    [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)]]
    pose[:3, 3] = [registered[key] for key in 'xyz']
    return pose
