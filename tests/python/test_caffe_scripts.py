"""Scripts of users: the program of docs/PYTHON.md, and scripts with `import caffe`."""

import os
import re
import subprocess
import sys
import unittest
from pathlib import Path

import caffe_needs  # noqa: F401
import numpy as np

import revisit.caffe as caffe
from folders import FolderTest

try:
    from PIL import Image
except ImportError:
    Image = None

PAGE = Path(__file__).parents[2] / 'docs/PYTHON.md'
NET = """
layer { name: "data" type: "Input" top: "data" input_param { shape { dim: 1 dim: 3 dim: 8 dim: 8 } } }
layer { name: "conv1" type: "Convolution" bottom: "data" top: "conv1"
        convolution_param { num_output: 3 kernel_size: 8 } }
layer { name: "prob" type: "Softmax" bottom: "conv1" top: "prob" }
"""
SCRIPT = """
import sys
import caffe
import caffe.io
from caffe import layers as L
from caffe.proto import caffe_pb2
from google.protobuf import text_format
import neighbor

net = text_format.Parse(open(sys.argv[1]).read(), caffe_pb2.NetParameter())
print(len(net.layer), caffe.Net(sys.argv[1], caffe.TEST).blobs['prob'].shape, neighbor.NAME, __name__)
"""


class Scripts(FolderTest):
    def setUp(self):
        super().setUp()
        (self.folder / 'deploy.prototxt').write_text(NET)

    def run_python(self, *arguments):
        done = subprocess.run(
            [sys.executable, *arguments],
            cwd=self.folder,
            text=True,
            capture_output=True,
            env=dict(os.environ),
        )
        self.assertEqual(done.returncode, 0, done.stdout + done.stderr)
        return done.stdout

    @unittest.skipIf(Image is None, 'pillow is not installed')
    def test_the_program_of_the_page(self):
        (program,) = (program for program in re.findall(r'```python\n(.*?)```', PAGE.read_text(), re.DOTALL)
                      if 'import revisit.caffe' in program)
        net = caffe.Net(str(self.folder / 'deploy.prototxt'), caffe.TEST)
        # One filter per channel: BGR, so red is the last.
        for channel in range(3):
            net.params['conv1'][0].data[channel, channel] = 1
        net.save(str(self.folder / 'model.caffemodel'))
        pixels = np.zeros((20, 30, 3), np.uint8)
        pixels[:, :, 0] = 255
        Image.fromarray(pixels).save(self.folder / 'cat.jpg', quality=100)
        self.assertEqual(self.run_python('-c', program).split('(')[0].strip(), '2')

    def test_import_caffe(self):
        (self.folder / 'scripts').mkdir()
        (self.folder / 'scripts/look.py').write_text(SCRIPT)
        (self.folder / 'scripts/neighbor.py').write_text('NAME = "beside"')
        (self.folder / 'link.py').symlink_to('scripts/look.py')  # imports come from the folder of the target, as in Python
        for script in ('scripts/look.py', 'link.py'):
            out = self.run_python('-m', 'revisit.caffe', script, 'deploy.prototxt')
            self.assertEqual(out.strip(), '3 [1, 3, 1, 1] beside __main__')


if __name__ == '__main__':
    unittest.main()
