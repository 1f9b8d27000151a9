#!/usr/bin/env python3
"""Checks README.md, HACKING.md, CHANGELOG.md and docs/ against the program and the tree.

  tests/documents/documents.py PROGRAM [DOCUMENT...]      all documents unless some are named

- Every fenced block names its language. Blocks of ```sh are run by bash in a folder made for the document
  (below), in the order of the text, and must succeed.
- A block of ```sh behind the comment <!-- not run: REASON --> is only checked: `revisit` must know the options, scripts and presets must exist,
  a Python script must know the options. Code between backquotes that begins with `revisit ` is checked likewise.
- Lines of a block behind <!-- output --> are printed by the block of commands before.
- A sentence has at most SENTENCE_WORDS words. A piece of code between backquotes is one word.
- A table cell has at most CELL_WORDS words, and no formula (FORMULA). Tables that a program writes are exempt.
- No line has one of the PHRASES.
- No page, no source file and no output of a block has one of the FORMER words: HACKING.md's glossary has the one name of each thing.
- Programs of ```cpp pass the compiler's checks, with the public headers of the engine, of recognition, maps, loops and registration.
- Links and pictures lead to existing files and headings. Source files that are named between backquotes exist.
- README's tagline stands in the files that describe the project elsewhere (TAGGED), and in `revisit --help`.
- A number with decimals in a table of the README stands in docs/, too: in a page, or in a file of docs/data/.
- CHANGELOG.md names options of the past, so its commands are not checked.

The folder holds the files that the commands name, made by the program itself: KITTI/ (a circle of 240 m, driven 15
times, as sequence 00 with as many poses as KITTI's, every 150th with a scan), scans/ (the same scans in a plain folder),
deploy.prototxt with model.caffemodel (AlexNet's first layers, random), data.npy (an input of 3 x 107 x 4000), cat.jpg (a picture).
"""

import argparse
import fnmatch
import json
import math
import os
import re
import shlex
import shutil
import struct
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / 'bench'))
import tables  # noqa: E402

# Commands of other projects, in blocks that are not run.
FOREIGN = {'apt', 'apt-get', 'cd', 'colcon', 'cpack', 'dpkg', 'dpkg-deb', 'env', 'for', 'g++', 'git', 'grep', 'ln', 'man', 'pip',
           'pkg-config', 'python3', 'ros2', 'source', 'sudo', 'xargs'}
POSES_OF_KITTI_00 = 4541
SENTENCE_WORDS = 25
CELL_WORDS = 12
PHRASES = re.compile(r'\b(is said|so many|less the|at hand|as far as|strangers?|looked at)\b', re.IGNORECASE)
# What the glossary of HACKING.md replaces; parts of identifiers count.
FORMER = re.compile(r'false_beyond|(?:incorrect|wrong|other)_beyond|runner_up|refusal|alteration|(?i:recognis(?:e|ing)\b|recogniser|metres\b|licence\b'
                    r'|colours?\b|optimis|neighbour|behaviour|initialise)|[Ss]toredPlace|PlaceRow|first_stretch|(?:ring_key|code|key)_candidates'
                    r'|learnt_from|columns_share|n_left_out|not_judged|not_described|CppName|kFeaturesOf|revisit::pipeline')
SOURCES = ('base', 'engine', 'proto', 'pipeline', 'simulator', 'tools', 'python', 'weights_conversion', 'examples', 'bench', 'tests')
# An equation or relation with spaces around its sign, a power, a sum, or a sign between a call or a single letter and a term.
FORMULA = re.compile(r'\s(?:=|<|>|<=|>=)\s|\w\^|\bsum over\b|\b(?:sqrt|exp)\(|\)\s[-+/]\s\w|(?<![\w.])[a-z]\s[-+/]\s[a-z](?!\w)')
# Have the tagline of README, its line in bold.
TAGGED = ('CITATION.cff', 'CMakeLists.txt', 'cmake/packaging/manual.sh', 'examples/ros2/package.xml', 'packaging/site/Doxyfile',
          'packaging/site/mkdocs.yml', 'pyproject.toml', 'python/revisit/__init__.py', '.github/workflows/release.yml')
ABBREVIATIONS = ('e.g.', 'i.e.', 'al.', 'vs.', 'cf.')


def documents():
    return [ROOT / 'README.md', ROOT / 'HACKING.md', ROOT / 'CHANGELOG.md', *sorted((ROOT / 'docs').rglob('*.md'))]


class Block:
    """A fenced block: `line` is its first, counted from 1; `reason` why it is not run."""

    def __init__(self, info, line, before):
        self.language, _, self.rest = info.partition(' ')
        self.line, self.text = line, ''
        comment = re.fullmatch(r'\s*<!-- not run: (.+) -->', before)
        self.reason = comment[1] if comment else None
        self.is_output = before.strip() == '<!-- output -->'


def split(document):
    """Returns the fenced blocks of a document, and its other lines (empty where a block is)."""
    blocks, prose, block, before = [], [], None, ''
    for number, line in enumerate(document.read_text().splitlines(), 1):
        fence = line.lstrip().startswith('```')
        if fence and block is None:
            block = Block(line.strip()[3:].strip(), number, before)
            blocks.append(block)
        elif fence:
            block = None
        elif block is not None:
            block.text += line + '\n'
        prose.append('' if fence or block is not None else line)
        before = line
    return blocks, prose


def plain(text):
    """Returns words of a piece of Markdown: a link is its text, a piece of code one word."""
    text = re.sub(r'`[^`]*`', 'CODE', text)
    text = re.sub(r'!?\[([^\]]*)\]\([^)]*\)', r'\1', text)
    return re.sub(r'<[^>]+>', '', text.replace('*', ''))


def sentences(prose):
    """Yields (number of its first line, words) of each sentence outside of blocks, tables, headings and comments."""
    paragraphs, fresh = [], True
    for number, line in enumerate(prose, 1):
        item = re.match(r'\s*(?:[-+]|\d+\.) ', line)
        if not line.strip() or line.lstrip().startswith(('|', '#', '<!--')):
            fresh = True
            continue
        if fresh or item:
            paragraphs.append((number, []))
        paragraphs[-1][1].append(line[item.end():] if item else line)
        fresh = False
    for number, lines in paragraphs:
        sentence = []
        for word in plain(' '.join(lines)).split():
            if re.search(r'\w', word):
                sentence.append(word)
            if re.search(r'[.!?][)"\']*$', word) and word.lstrip('("') not in ABBREVIATIONS and sentence:
                yield number, sentence
                sentence = []
        if sentence:
            yield number, sentence


def cells(prose):
    """Yields (number of its line, text) of each table cell, without tables that a program writes."""
    written = False
    for number, line in enumerate(prose, 1):
        if line.startswith('<!-- ') and not line.startswith('<!-- not run'):
            written = not line.startswith('<!-- end')
        elif line.startswith('|'):
            if not written and not re.fullmatch(r'[|: -]+', line):
                yield from ((number, cell) for cell in line.strip().strip('|').split('|'))
        elif line.strip() and not line.startswith('```'):
            written = False


def commands(text):
    """Yields the words of every simple command of a piece of shell, without comments and redirections."""
    for line in text.replace('\\\n', ' ').splitlines():
        lexer = shlex.shlex(line, posix=True, punctuation_chars='();&|<>')
        lexer.whitespace_split = True
        words = []
        for word in [*lexer, ';']:
            if word in ('do', 'done', 'then', ';', '&&', '||', '|', '(', ')', '&'):
                if words:
                    yield words
                words = []
            else:
                words.append(word)


class Checker:
    def __init__(self, program):
        self.program, self.help, self.faults = program, {}, []
        presets = json.loads((ROOT / 'CMakePresets.json').read_text())
        self.sources = [str(file) for folder in ROOT.iterdir() if folder.name not in ('build', 'results', '.git')
                        for file in folder.rglob('*.*')]
        self.presets = {preset['name'] for preset in presets['configurePresets']}

    def fault(self, document, line, text):
        self.faults.append(f'{document.relative_to(ROOT)}:{line}: {text}')

    def help_of(self, *command):
        if command not in self.help:
            how = '--help=all' if command[0] == self.program else '--help'
            done = subprocess.run([*command, how], text=True, capture_output=True)
            self.help[command] = done.stdout if done.returncode == 0 else None
        return self.help[command]

    def unknown_options(self, text, words):
        known = set(re.findall(r'(?<![\w-])--?[A-Za-z][\w-]*', text))
        return [word for word in (word.split('=')[0] for word in words)
                if re.fullmatch(r'--?[A-Za-z][\w-]*', word) and word not in known]

    def check_revisit(self, words):
        """Returns the error of the command line `revisit WORDS`, or None. Words in capitals match anything."""
        verbs = []
        for word in words[:2 if words[:1] in (['net'], ['models'], ['map']) else 1]:
            if word.startswith('-') or not re.fullmatch(r'[a-z-]+', word):
                break
            verbs.append(word)
        text = self.help_of(self.program, *verbs)
        if text is None:
            return 'there is no `revisit ' + ' '.join(verbs) + '`'
        unknown = self.unknown_options(text, words[len(verbs):])
        return f'`revisit {" ".join(verbs)}` has no {", ".join(unknown)}' if unknown else None

    def check_command(self, words):
        name = words[0].removeprefix('venv/bin/')  # in a virtual environment that the block creates
        if name == 'revisit':
            return self.check_revisit(words[1:])
        if name == 'revisit-convert':
            text = (ROOT / 'weights_conversion/conversion/__main__.py').read_text()
            if f"\n    '{words[1]}': Command(" not in text:
                return f'there is no `revisit-convert {words[1]}`'
            unknown = self.unknown_options(text, words[2:])
            return f'revisit-convert has no {", ".join(unknown)}' if unknown else None
        if name in ('revisit-loops', 'revisit-simulate'):  # names of their own for commands
            return self.check_revisit([name.removeprefix('revisit-'), *words[1:]])
        if name in ('cmake', 'ctest') and '--preset' in words:
            preset = words[words.index('--preset') + 1]
            return None if preset in self.presets else f'there is no preset {preset}'
        if name.startswith('build/'):
            return None if name.split('/')[1] in self.presets | {'bench', 'venv'} else f'no preset builds {name}'
        if '/' in name:
            script = ROOT / name
            if not os.access(script, os.X_OK):
                return f'{name} is not there, or no program'
            if script.suffix == '.py':
                text = self.help_of(str(script)) or ''
                unknown = self.unknown_options(text, words[1:])
                return f'{name} has no {", ".join(unknown)}' if unknown else None
            return None
        return None if name in FOREIGN or name in ('cmake', 'ctest') else f'the test does not know the command {name}'

    def check_block(self, document, block):
        if 'pip install' in block.text and 'venv' not in block.text:
            self.fault(document, block.line, "pip without a virtual environment, which Debian's Python refuses")
        for words in commands(block.text):
            wrong = self.check_command(words)
            if wrong:
                self.fault(document, block.line, wrong)

    def check_wording(self, document, prose):
        for number, words in sentences(prose):
            if len(words) > SENTENCE_WORDS:
                self.fault(document, number, f'a sentence has {len(words)} words (at most {SENTENCE_WORDS}): {" ".join(words[:8])} ...')
        for number, cell in cells(prose):
            n_words = len(plain(cell).split())
            if n_words > CELL_WORDS:
                self.fault(document, number, f'a cell has {n_words} words (at most {CELL_WORDS}): {cell.strip()[:60]} ...')
            if FORMULA.search(cell):
                self.fault(document, number, f'a cell has a formula, which belongs into the text: {cell.strip()}')
        for number, line in enumerate(document.read_text().splitlines(), 1):
            for phrase in PHRASES.findall(line):
                self.fault(document, number, f'"{phrase}": write who does what, with the terms of the field')
            for word in FORMER.findall(line):
                self.fault(document, number, f'"{word}" is a former word; the glossary of HACKING.md has the present one')

    def check_sources(self):
        for folder in SOURCES:
            for file in sorted((ROOT / folder).rglob('*.*')):
                if file.suffix not in ('.cpp', '.h', '.py', '.proto', '.cmake', '.sh', '.js') or file == Path(__file__).resolve():
                    continue
                for number, line in enumerate(file.read_text().splitlines(), 1):
                    for word in FORMER.findall(line):
                        self.fault(file, number, f'"{word}" is a former word; the glossary of HACKING.md has the present one')

    def check_tagline(self):
        tagline = re.search(r'(?m)^\*\*(.+)\.\*\*$', (ROOT / 'README.md').read_text())[1].lower()
        texts = {ROOT / name: (ROOT / name).read_text() for name in TAGGED} | {ROOT / 'revisit --help': self.help_of(self.program)}
        for file, text in texts.items():
            if tagline not in ' '.join(text.lower().split()):
                self.fault(file, 1, f'README has another tagline: {tagline}')

    def check_code(self, document, prose):
        for number, line in enumerate(prose, 1):
            for code in re.findall(r'`(revisit [^`]+)`', line):
                try:
                    words = next(commands(code))
                except (StopIteration, ValueError):
                    continue
                wrong = self.check_revisit(words[1:])
                if document.name == 'README.md' and line.startswith('|') and not wrong:  # a whole command, whose files are not there
                    with tempfile.TemporaryDirectory() as folder:
                        done = subprocess.run([self.program, *words[1:]], cwd=folder, capture_output=True, text=True)
                    wrong = done.returncode == 2 and done.stderr.strip()
                if wrong:
                    self.fault(document, number, wrong)
            for name in re.findall(r'`([\w./*-]+\.(?:cmake|cpp|h|proto|py|sh))`', line):
                if not Path(name).stem.isupper() and not fnmatch.filter(self.sources, f'*/{name}'):
                    self.fault(document, number, f'{name} is not there')

    def check_links(self, document, prose):
        for number, line in enumerate(prose, 1):
            for target in re.findall(r'\]\(([^)\s]+)\)', line) + re.findall(r'src(?:set)?="([^"]+)"', line):
                if '://' not in target and not self.leads_somewhere(document, target):
                    self.fault(document, number, f'{target} leads nowhere')

    def check_program(self, document, block):
        folders = ('base', 'engine', 'proto', 'pipeline/recognition', 'pipeline/loops', 'pipeline/maps', 'pipeline/registration')
        includes = [f'-I{ROOT / folder / "include"}' for folder in folders]
        includes += ['-isystem', '/usr/include/eigen3', '-isystem', '/usr/include/opencv4']
        done = subprocess.run(['c++', '-std=c++20', '-fsyntax-only', '-xc++', *includes, '-'], input=block.text, text=True,
                              capture_output=True)
        if done.returncode != 0:
            self.fault(document, block.line, done.stderr)

    def check_numbers(self, readme):
        pages = ''.join(page.read_text() for page in [*(ROOT / 'docs').rglob('*.md'), *(ROOT / 'docs/data').glob('*.csv')])
        known = set(re.findall(r'\d+\.\d+', pages))
        for number, line in enumerate(readme.read_text().splitlines(), 1):
            for cell in line.split('|')[2:] if line.startswith('|') else []:
                for value in re.findall(r'^[ *]*(\d+\.\d+)[ *]*$', cell):
                    if value not in known:
                        self.fault(readme, number, f'{value} stands neither in a page of docs/ nor in docs/data/')

    def check_tables(self, document):
        lines = document.read_text().splitlines()
        for begin, end, right in tables.tables_in(lines):
            if lines[begin:end] != right:
                self.fault(document, begin, 'the table is not what its file has: run bench/tables.py')

    def leads_somewhere(self, document, target):
        path, _, heading = target.partition('#')
        file = document.parent / path if path else document
        if not file.exists():
            return False
        titles = re.findall(r'(?m)^#+ (.*)$', file.read_text()) if heading else []
        return not heading or heading in [re.sub(r'[^\w\- ]', '', t.lower()).replace(' ', '-') for t in titles]


def write_circle(file, n, step=0.8, length=240.0):
    """Writes `n` poses on a circle in KITTI's format: 3 x 4, camera axes (x right, z forward), [m]."""
    radius = length / (2 * math.pi)
    with file.open('w') as out:
        for i in range(n):
            angle = i * step / radius
            c, s = math.cos(angle), math.sin(angle)
            pose = (c, 0, s, radius * (1 - c), 0, 1, 0, 0, -s, 0, c, radius * s)
            out.write(' '.join(f'{value:.6e}' for value in pose) + '\n')


def write_npy(file, shape):
    header = f"{{'descr': '<f4', 'fortran_order': False, 'shape': {shape}, }}"
    header += ' ' * (-(len(header) + 11) % 64) + '\n'
    count = math.prod(shape)
    with file.open('wb') as out:
        out.write(b'\x93NUMPY\x01\x00' + struct.pack('<H', len(header)) + header.encode())
        out.write(b''.join(struct.pack('<f', i % 251) for i in range(251)) * (count // 251 + 1))
        out.truncate(10 + len(header) + 4 * count)


def make_things(revisit, folder):
    write_circle(folder / 'circle.txt', POSES_OF_KITTI_00)
    for arguments in (['simulate', '-q', '-o', 'KITTI', '--poses', 'circle.txt', '--every', '150'],
                      ['models', 'make-random', '-o', 'random']):
        subprocess.run([revisit, *arguments], cwd=folder, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    shutil.copytree(folder / 'KITTI/sequences/00/velodyne', folder / 'scans')
    for suffix, name in (('prototxt', 'deploy.prototxt'), ('caffemodel', 'model.caffemodel')):
        shutil.move(folder / f'random/alexnet_random.{suffix}', folder / name)
    write_npy(folder / 'data.npy', (1, 3, 107, 4000))
    shutil.copy(ROOT / 'tests/fixtures/pictures/color.jpg', folder / 'cat.jpg')


def environment_of(folder, program):
    (folder / 'bin').mkdir()
    (folder / 'bin/revisit').symlink_to(program)
    kept = {k: v for k, v in os.environ.items() if not k.startswith('REVISIT_') and k != 'PYTHONPATH'}
    return kept | {'PATH': f'{folder}/bin:{kept["PATH"]}', 'HOME': str(folder)}


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('program', type=Path, help='the built `revisit`')
    parser.add_argument('document', type=Path, nargs='*')
    arguments = parser.parse_args()
    program = str(arguments.program.resolve())
    checker, n_run, n_checked = Checker(program), 0, 0
    with tempfile.TemporaryDirectory(prefix='revisit_documents_') as scratch:
        things = Path(scratch, 'things')
        things.mkdir()
        make_things(program, things)
        if not arguments.document:
            checker.check_sources()
            checker.check_tagline()
        for document in [d.resolve() for d in arguments.document] or documents():
            blocks, prose = split(document)
            checker.check_wording(document, prose)
            checker.check_links(document, prose)
            if document.name == 'CHANGELOG.md':
                continue
            checker.check_code(document, prose)
            checker.check_tables(document)
            if document.name == 'README.md':
                checker.check_numbers(document)
            shell, printed = [block for block in blocks if block.language == 'sh' or block.is_output], ''
            folder = Path(scratch, document.stem)
            shutil.copytree(things, folder, copy_function=os.link)
            environment = environment_of(folder, program)
            for block in blocks:
                if not block.language:
                    checker.fault(document, block.line, 'the block says no language (sh, text, cpp ...)')
                elif block.language == 'cpp':
                    checker.check_program(document, block)
                elif block.rest:
                    checker.fault(document, block.line, 'behind the language stands nothing; <!-- not run: REASON --> stands before the block')
            for block in shell:
                if block.is_output:
                    for line in filter(None, map(str.strip, block.text.splitlines())):
                        if ' '.join(line.split()) not in printed:
                            checker.fault(document, block.line, f'the commands before do not print: {line}')
                    continue
                if block.reason:
                    checker.check_block(document, block)
                    n_checked += 1
                    continue
                done = subprocess.run(['bash', '-euo', 'pipefail', '-c', block.text], cwd=folder, env=environment, text=True,
                                      stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
                n_run, printed = n_run + 1, ' '.join(done.stdout.split())
                for word in set(FORMER.findall(done.stdout)):
                    checker.fault(document, block.line, f'the output has the former word "{word}"')
                if done.returncode != 0:
                    checker.fault(document, block.line, f'exit code {done.returncode} of\n{block.text}{done.stdout}')
    print(f'{n_run} blocks of commands were run, {n_checked} checked without running them')
    print('\n'.join([*checker.faults, f'{len(checker.faults)} faults']))
    return 1 if checker.faults else 0


if __name__ == '__main__':
    sys.exit(main())
