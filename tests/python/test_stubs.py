"""The generated stubs match the modules, every public name has a docstring, and type checkers accept the examples."""

import ast
import importlib
import importlib.util
import os
import subprocess
import sys
import unittest
from pathlib import Path

import revisit
from revisit import _core

ROOT = Path(__file__).resolve().parents[2]
STUBS = Path(_core.__file__).with_name('_core')
DOCUMENTED = ('', '.errors', '.datasets', '.engine', '.evaluation', '.maps', '.proto', '.recognition', '.registration', '.loops', '.poses',
              '.program', '.recordings', '.show', '.dnn', '.caffe', '.caffe.classifier', '.caffe.coord_map', '.caffe.draw', '.caffe.io',
              '.caffe.net_spec')


def public(tree):
    """Yields the definitions of a stub that users see, with their names."""
    for node in tree.body:
        if isinstance(node, (ast.ClassDef, ast.FunctionDef)) and (not node.name.startswith('_') or node.name in ('__init__', '__call__')):
            if not any('setter' in ast.unparse(each) for each in node.decorator_list):
                yield node.name, node
            if isinstance(node, ast.ClassDef):
                yield from ((f'{node.name}.{name}', inner) for name, inner in public(node))


def without_docstring(module):
    """Yields the public functions, classes, methods and properties of a module in Python that have none."""
    if not module.__doc__:
        yield module.__name__
    own = [name for name, value in vars(module).items() if not name.startswith('_') and getattr(value, '__module__', '') == module.__name__]
    for name in getattr(module, '__all__', own):
        value = getattr(module, name)
        origin = getattr(value, '__module__', None) or ''
        if not callable(value) or not origin.startswith('revisit.') or '._core' in origin:
            continue
        members = vars(value) if isinstance(value, type) else {}
        for inner, member in {'': value, **members}.items():
            member = getattr(member, '__func__', member)
            if not inner.startswith('_') and (callable(member) or isinstance(member, property)) and not member.__doc__:
                yield f'{module.__name__}.{name}.{inner}'.rstrip('.')


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

    def test_every_name_has_a_docstring(self):
        lacking = [f'{file.stem}.{name}' for file in sorted(STUBS.glob('*.pyi')) for name, node in public(ast.parse(file.read_text()))
                   if not ast.get_docstring(node)]
        for name in DOCUMENTED:
            lacking += without_docstring(importlib.import_module('revisit' + name))
        self.assertEqual(lacking, [])

    @unittest.skipUnless(importlib.util.find_spec('mypy'), 'needs mypy')
    def test_mypy_accepts_stubs_and_examples(self):
        strict = ['--strict', '--allow-untyped-defs', '--allow-any-generics', '--ignore-missing-imports', '--cache-dir', os.devnull]
        for options, files in ((['--follow-imports', 'silent'], [STUBS]),
                               (['--follow-imports', 'silent', '--allow-untyped-calls'], sorted((ROOT / 'examples').glob('*.py')))):
            done = subprocess.run([sys.executable, '-m', 'mypy', *strict, *options, *files], capture_output=True, text=True,
                                  cwd=ROOT, env=os.environ | {'MYPYPATH': str(STUBS.parents[1])})
            self.assertEqual(done.returncode, 0, done.stdout + done.stderr)

    def test_are_announced(self):
        self.assertTrue(Path(revisit.__file__).with_name('py.typed').is_file())


if __name__ == '__main__':
    unittest.main()
