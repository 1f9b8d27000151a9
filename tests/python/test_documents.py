"""Runs the programs of docs/PYTHON.md, docs/MAPS.md and docs/OPENCV.md in order, in a folder with the files that they use."""

import importlib
import os
import re
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

import numpy as np

from revisit import datasets, proto
from scans import room

ROOT = Path(__file__).resolve().parents[2]
NET = """
layer { name: "data" type: "Input" top: "data" input_param { shape { dim: 1 dim: 3 dim: 227 dim: 227 } } }
layer { name: "conv1" type: "Convolution" bottom: "data" top: "conv1"
        convolution_param { num_output: 2 kernel_size: 11 stride: 4 } }
layer { name: "conv3" type: "Convolution" bottom: "conv1" top: "conv3" convolution_param { num_output: 2 kernel_size: 3 } }
layer { name: "relu3" type: "ReLU" bottom: "conv3" top: "conv3" }
layer { name: "pool5" type: "Pooling" bottom: "conv3" top: "pool5" pooling_param { kernel_size: 3 stride: 2 } }
"""


def prepare(folder):
    (folder / 'deploy.prototxt').write_text(NET)
    net = proto.parse_net(NET)
    net.set_weights({'conv1': [np.ones((2, 3, 11, 11), np.float32), np.zeros(2, np.float32)],
                     'conv3': [np.ones((2, 2, 3, 3), np.float32), np.zeros(2, np.float32)]})
    net.write_binary(folder / 'model.caffemodel')
    np.save(folder / 'data.npy', np.ones((1, 3, 107, 4000), np.float32))
    (folder / 'scans').mkdir()
    for i in range(3):
        datasets.write_kitti_scan(folder / 'scans' / f'{i:06}.bin', room(i))


class Documents(unittest.TestCase):
    def test_programs_run(self):
        text = ''.join((ROOT / 'docs' / page).read_text() for page in ('PYTHON.md', 'MAPS.md', 'OPENCV.md'))
        programs = [program for program in re.findall(r'```python\n(.*?)```', text, re.DOTALL)
                    if 'import revisit.caffe' not in program]  # run by test_caffe_scripts.py
        self.assertEqual(len(programs), 6)
        with tempfile.TemporaryDirectory() as folder:
            prepare(Path(folder))
            for program in programs:
                done = subprocess.run([sys.executable, '-c', program], cwd=folder, text=True, capture_output=True,
                                      env=dict(os.environ))
                self.assertEqual(done.returncode, 0, program + done.stdout + done.stderr)

    def test_modules_are_those_of_the_table(self):
        import revisit
        text = (ROOT / 'docs/PYTHON.md').read_text()
        for name in ('datasets', 'engine', 'evaluation', 'maps', 'proto', 'recognition'):
            self.assertIn(f'| `{name}` |', text)
            self.assertTrue(hasattr(revisit, name))
        for name in ('dnn', 'loops', 'poses', 'program', 'recordings', 'show'):  # not imported by `import revisit`
            self.assertIn(f'| `{name}` |', text)
            importlib.import_module(f'revisit.{name}')


if __name__ == '__main__':
    unittest.main()
