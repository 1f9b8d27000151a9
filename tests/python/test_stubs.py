"""The generated stubs match the modules."""

import ast
import unittest
from pathlib import Path

import revisit
from revisit import _core

STUBS = Path(_core.__file__).with_name('_core')


class Stubs(unittest.TestCase):
    def test_name_types_of_python_only(self):
        files = sorted(STUBS.glob('*.pyi'))
        self.assertGreaterEqual(len(files), 3)
        for file in files:
            text = file.read_text()
            ast.parse(text)
            self.assertNotIn('::', text, file)

    def test_have_all_public_names(self):
        for name in revisit.__all__:
            module = getattr(revisit, name)
            stub = STUBS / f'{name}.pyi'
            if not stub.is_file():
                continue
            tree = ast.parse(stub.read_text())
            known = {node.name for node in tree.body if isinstance(node, (ast.ClassDef, ast.FunctionDef))}
            own = {'Evaluation', 'POINT_TIME_NAMES', 'evaluate', 'fit_pca', 'labels', 'open_map', 'point_times'}  # written in Python
            self.assertLessEqual(set(module.__all__) - own, known, name)

    def test_are_announced(self):
        self.assertTrue(Path(revisit.__file__).with_name('py.typed').is_file())


if __name__ == '__main__':
    unittest.main()
