"""Common code of the converters' tests."""

import contextlib
import io
import os
import tempfile
import unittest
from pathlib import Path
from unittest import mock

import numpy as np

from conversion import compare
from conversion.__main__ import main, parser

ROOT = Path(__file__).resolve().parents[2]
GOLDEN = ROOT / 'tests' / 'golden'
SHARED = Path(os.environ.get('REVISIT_TEST_DATA', ROOT.parent / 'shared'))


class ConversionTest(unittest.TestCase):
    """convert() runs revisit-convert in a temporary folder, and replaces what an earlier call wrote there."""

    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = Path(folder.name)
        self.written = set()  # outputs of earlier calls

    def path(self, name):
        return self.folder / name

    def convert(self, *words, code=0, tolerance=1e-4):
        """The command must exit with `code`. Returns its output, from both streams. tolerance: of comparisons."""
        printed, words = io.StringIO(), list(map(str, words))
        with contextlib.redirect_stdout(printed), contextlib.redirect_stderr(printed), \
                mock.patch.object(compare, 'TOLERANCE', tolerance):
            try:
                options = parser().parse_args(words)
                outputs = {Path(path) for path, _ in options.run.outputs(options)}
                for file in outputs & self.written:
                    file.unlink(missing_ok=True)
                self.written |= outputs
                found = main(words)
            except SystemExit as end:  # argparse
                found = end.code
        self.assertEqual(found, code, printed.getvalue())
        self.assertNotIn('Traceback', printed.getvalue())
        return printed.getvalue()

    def refused(self, code, message, *words):
        """The command must exit with `code` and one line that contains `message`."""
        printed = self.convert(*words, code=code)
        lines = [line for line in printed.splitlines() if line.startswith('revisit-convert: ')]
        self.assertEqual(len(lines), 1, printed)
        self.assertIn(message, lines[0])

    def net(self, text, blobs, name='net'):
        from conversion import weights
        prototxt, model = self.path(f'{name}.prototxt'), self.path(f'{name}.caffemodel')
        prototxt.write_text(text)
        weights.write_caffemodel(model, {layer: [np.asarray(a, np.float32) for a in arrays] for layer, arrays in blobs.items()})
        return prototxt, model


def input_layer(*shape):
    return 'layer { name: "data" type: "Input" top: "data" input_param { shape { ' + \
        ' '.join(f'dim: {size}' for size in shape) + ' } } }\n'


def layer(name, kind, bottom='data', top=None, parameters=''):
    bottoms = ' '.join(f'bottom: "{blob}"' for blob in ([bottom] if isinstance(bottom, str) else bottom))
    tops = ' '.join(f'top: "{blob}"' for blob in ([top or name] if not isinstance(top, list) else top))
    return f'layer {{ name: "{name}" type: "{kind}" {bottoms} {tops} {parameters} }}\n'


def numbers(*shape, seed=0):
    return np.random.default_rng(seed).normal(0, 1, shape).astype(np.float32)
