"""Writes the pages of Python's API with pdoc: python_api.py FOLDER. The documented package is the one that this interpreter imports.
The pages of both APIs, beside FOLDER, get the script scheme.js.

pdoc cannot read the signatures of an extension, so it gets a copy of the package in which the stubs stand for the extension.
"""

import ast
import importlib.util
import inspect
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

FORMATTED = inspect.formatannotation
MODULES = ['revisit', 'revisit.dnn', 'revisit.caffe', 'revisit.caffe.classifier', 'revisit.caffe.draw', 'revisit.loops', 'revisit.poses',
           'revisit.program', 'revisit.recordings', 'revisit.registration', 'revisit.show']
POINTS = 'numpy.typing.NDArray | tuple[numpy.typing.NDArray, numpy.typing.NDArray, numpy.typing.NDArray]'
TYPES = """
class NDArray:
    def __class_getitem__(cls, item):
        import types
        return types.GenericAlias(cls, item)
class Points:
    pass
class _Default:
    def __repr__(self):
        return '...'
NDArray.__module__, Points.__module__ = 'typing', 'builtins'
"""
SHORTER = [(r'(typing\.)?Union\[numpy\._typing\._array_like\.\w*?Buffer.*?complex \| bytes \| str\]\]', 'ArrayLike'),
           (r'numpy\.ndarray\[tuple\[(?:typing\.)?Any, \.\.\.\], numpy\.dtype\[([\w.]+)\]\]', r'NDArray[\1]'),
           (r'\b(revisit\._core\.\w+|collections\.abc|numpy|typing|pathlib|os)\.', ''), (r'^"(.*)"$', r'\1')]


def shown(annotation, *arguments, **options):
    """Returns an annotation as a reader writes it."""
    text = FORMATTED(annotation, *arguments, **options)
    for pattern, shorter in SHORTER:
        text = re.sub(pattern, shorter, text)
    return text


def as_module(stub, name):
    """Returns the Python code of a stub, whose classes are shown as those of revisit.NAME."""
    text = stub.replace(POINTS, 'Points')
    text = re.sub(r'Annotated\[(NDArray\[[\w.]+\]), dict\((?:\([^()]*\)|[^()])*\)\]', r'\1', text)
    text = re.sub(r'^import (revisit\._core\.(\w+))$', r'import \1 as _\2', text, flags=re.M)
    text = re.sub(r'(?<!import )revisit\._core\.(\w+)\.', r'_\1.', text)
    text = re.sub(r'(?=\n\n\n)', '\n' + TYPES, text, count=1)
    text = re.sub(r' = \.\.\.(?=[,)])', ' = _Default()', text)
    head, rest = re.match(r'(""".*?"""\n|)(.*)', text, re.S).groups()
    return f'{head}from __future__ import annotations\n{rest}\n\n' + f"""
for _each in list(globals().values()):
    if isinstance(_each, type) and _each.__module__ == __name__:
        _each.__module__ = 'revisit.{name}'
"""


def with_lists(docstring):
    """Lines `name: text` become a list, and errors a paragraph."""
    text = re.sub(r'^(\w+(?:, \w+)*): (?=\S)', r'- **\1**: ', docstring, flags=re.M)
    text = re.sub(r'^(?!- )(.*)\n(?=- \*\*)', r'\1\n\n', text, flags=re.M)
    return re.sub(r'\n(?=Raises )', r'\n\n', text)


def copied(folder):
    package = Path(importlib.util.find_spec('revisit').origin).parent
    read = 'import revisit; print((revisit.proto.schema(), revisit.__version__))'
    schema, version = ast.literal_eval(subprocess.run([sys.executable, '-c', read], check=True, capture_output=True, text=True).stdout)
    copy = folder / 'revisit'
    shutil.copytree(package, copy, ignore=shutil.ignore_patterns('*.so', 'bin', '__pycache__', 'conversion'))
    for stub in (copy / '_core').glob('*.pyi'):
        code = as_module(stub.read_text(), stub.stem)
        if stub.stem == '__init__':
            code += f'\n__version__ = {version!r}\n'
        if stub.stem == 'proto':  # which revisit.caffe reads on import
            code = re.sub(r'(def schema\(\) -> bytes:\n    """.*?""")', lambda match: f'{match[1]}\n    return {schema!r}', code, flags=re.S)
        stub.with_suffix('.py').write_text(code)


def main(output):
    inspect.formatannotation = shown
    import pdoc
    import pdoc.docstrings
    import pdoc.render
    convert = pdoc.docstrings.convert
    pdoc.docstrings.convert = lambda docstring, *arguments: convert(with_lists(docstring), *arguments)
    pdoc.render.configure(show_source=False, docformat='google', template_directory=Path(__file__).with_name('pdoc'))
    with tempfile.TemporaryDirectory() as folder:
        copied(Path(folder))
        sys.path.insert(0, folder)
        pdoc.pdoc(*MODULES, output_directory=output)
    script = Path(__file__).with_name('scheme.js').read_text()
    for page in output.parent.rglob('*.html'):
        page.write_text(page.read_text().replace('</head>', f'<script>\n{script}</script>\n</head>', 1))


main(Path(sys.argv[1]))
