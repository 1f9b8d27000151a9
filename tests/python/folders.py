"""Base class of tests that write files, and a format for them."""

import tempfile
import unittest
from pathlib import Path

import numpy as np


class FolderTest(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = Path(folder.name)


def tum_line(time, pose) -> str:
    """time x y z qx qy qz qw"""
    (a, b, c), (d, e, f), (g, h, i) = pose[:3, :3]
    # The quaternion is the eigenvector of the largest eigenvalue (Bar-Itzhack, JGCD 2000).
    K = np.array([[a - e - i, b + d, c + g, h - f], [b + d, e - a - i, f + h, c - g], [c + g, f + h, i - a - e, d - b],
                  [h - f, c - g, d - b, a + e + i]])
    q = np.linalg.eigh(K)[1][:, -1]
    return ' '.join([f'{time:.6f}', *(f'{value:.6f}' for value in pose[:3, 3]), *(f'{value:.9f}' for value in q)])
