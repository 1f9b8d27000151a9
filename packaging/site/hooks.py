"""Hooks of mkdocs: pages from outside of docs/, a page for each command, and links as the site has them."""

import importlib.util
import os
import re
import subprocess
import sys
from pathlib import Path

from mkdocs.structure.files import File
from mkdocs.structure.nav import Link

ROOT = Path(__file__).resolve().parents[2]
OUTSIDE = {'README.md': 'overview.md', 'HACKING.md': 'HACKING.md', 'CHANGELOG.md': 'CHANGELOG.md'}
REPOSITORY = os.environ.get('REVISIT_REPOSITORY', '')  # address of the sources, as https://github.com/NAME/revisit
PROGRAM = os.environ.get('REVISIT_PROGRAM', str(ROOT / 'build' / 'release' / 'tools' / 'revisit'))
COMMAND = re.compile(r'^  ([a-z][a-z-]+) {2,}(\S.*)', re.M)
OPTION = re.compile(r'^ {2,6}(-\S.*?)(?: {2,}(\S.*))?$')
LINK = re.compile(r'(?P<label>!?\[(?:[^\[\]]|\[[^\]]*\](?:\([^)]*\))?)*\])\((?P<path>[^)#\s]*)(?P<anchor>#[^)\s]*)?\)')
API = {'API of Python': 'api/python/revisit.html', 'API of C++': 'api/cpp/index.html'}  # written by build.sh, into the section Reference
FENCED = re.compile(r'(^ *```.*?^ *```$)', re.M | re.S)


def help_of(*words):
    command = [PROGRAM, *words, '--help=all'] if words else [PROGRAM, '--help']
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout


def commands():
    """Yields the words of each command and its help: `net`, `map` and `models` have commands of their own."""
    for name, _ in COMMAND.findall(help_of()):
        text = help_of(name)
        yield [name], text
        if re.search(rf'^Usage: revisit {name} COMMAND', text, re.M):
            for verb, _ in COMMAND.findall(text):
                yield [name, verb], help_of(name, verb)


def escaped(text):
    """Markdown of plain text in which a piece between backquotes is code."""
    parts = re.split(r'(`[^`]*`)', text)
    return ''.join(part if part.startswith('`') else re.sub(r'([\\`*_{}\[\]<>|#])', r'\\\1', part) for part in parts)


def options_of(lines):
    """Markdown of the options: a heading for each group, a table of its options."""
    text, row = [], None
    for line in [*lines, '']:
        option, group = OPTION.match(line), re.fullmatch(r' (\S.*):', line)
        if row and (option or group or not line.strip()):
            name, meaning = row
            text.append(f'| `{name}` | {escaped(" ".join(meaning))} |')
            row = None
        if group:
            text += ['', f'### {group[1]}', '', '| option | meaning |', '|---|---|']
        elif option:
            if not text or not text[-1].startswith('|'):
                text += ['', '| option | meaning |', '|---|---|']
            row = option[1], [option[2]] if option[2] else []
        elif row:
            row[1].append(line.strip())
        elif line.strip():
            text += ['', escaped(line.strip())]
    return '\n'.join(text)


def page_of(words, text):
    usage = re.search(r'^Usage: (.*)$', text, re.M)
    text = text.replace(usage[0] + '\n', '', 1)
    head, _, options = text.partition('\nOptions:\n')
    page = [f'# revisit {" ".join(words)}', f'```text\n{usage[1]}\n```']
    for part in re.split(r'\n\s*\n', head.strip()):
        if part.startswith('Examples:'):
            commands_shown = '\n'.join(line.strip() for line in part.splitlines()[1:])
            page.append(f'## Examples\n\n```sh\n{commands_shown}\n```')
        elif COMMAND.match(part):
            page.append('\n'.join(f'- [{verb}]({"-".join([*words, verb])}.md): {escaped(meaning)}' for verb, meaning in COMMAND.findall(part)))
        else:
            page.append(escaped(part))
    if options.strip():
        page.append('## Options\n' + options_of(options.splitlines()))
    return '\n\n'.join(page) + '\n'


def python_programs():
    """Yields title, file and help of each program of the Python package; none without the package."""
    def help_text(module, *words):
        return subprocess.run([sys.executable, '-m', module, *words, '--help'], check=True, capture_output=True, text=True,
                              env=os.environ | {'COLUMNS': '100'}).stdout
    if not importlib.util.find_spec('revisit'):
        return
    overview = help_text('revisit.conversion')
    yield 'revisit-convert', 'revisit-convert', overview
    for verb in re.findall(r'^    ([a-z]+)\b', overview.partition('COMMAND\n')[2], re.M):
        yield f'revisit-convert {verb}', f'revisit-convert-{verb}', help_text('revisit.conversion', verb)
    for module in ('revisit.recordings', 'revisit.show'):
        yield f'python3 -m {module}', module.replace('.', '-'), help_text(module)


def on_config(config):
    config['repo_url'] = REPOSITORY or None
    pages = [(f'revisit {" ".join(words)}', "-".join(words), page_of(words, text)) for words, text in commands()]
    pages += [(title, name, f'# {title}\n\n```text\n{text.rstrip()}\n```\n') for title, name, text in python_programs()]
    config['pages_of_commands'] = {f'commands/{name}.md': text for _, name, text in pages}
    listed = [{title: f'commands/{name}.md'} for title, name, _ in pages]

    def filled(nav):
        if isinstance(nav, list):
            return [filled(item) for item in nav]
        if isinstance(nav, dict):
            return {title: listed if value == 'COMMANDS' else filled(value) for title, value in nav.items()}
        return nav
    config['nav'] = filled(config['nav'])
    return config


def on_files(files, config):
    for source, page in OUTSIDE.items():
        files.append(File.generated(config, page, content=(ROOT / source).read_text()))
    files.append(File.generated(config, 'extra.css', content=Path(__file__).with_name('extra.css').read_text()))
    for page, text in config['pages_of_commands'].items():
        files.append(File.generated(config, page, content=text))
    return files


def on_nav(nav, config, files):
    reference = next(item for item in nav.items if item.title == 'Reference')
    reference.children[:0] = [Link(title, url) for title, url in API.items()]
    return nav


def with_lists_apart(text):
    """A list begins after an empty line, which GitHub does not need."""
    return re.sub(r'^((?![-+*|#<>]|\d+\. )\S.*)\n(?=(?:[-+*]|\d+\.) )', r'\1\n\n', text, flags=re.M)


def with_themes(text):
    """A picture for each theme, which the site's switch selects, in place of <picture>, which the system selects."""
    def images(match):
        dark = re.search(r'<source media="\(prefers-color-scheme: dark\)" srcset="([^"]+)"', match[0])
        image = re.search(r'<img [^>]*src="([^"]+)"[^>]*>', match[0])
        if not dark:
            return image[0]
        return image[0].replace(image[1], image[1] + '#only-light') + image[0].replace(image[1], dark[1] + '#only-dark')
    return re.sub(r'<picture>.*?</picture>', images, text, flags=re.S)


def on_page_markdown(markdown, page, config, files):
    """Relative links are those of the tree; in the site README, HACKING and CHANGELOG are pages beside those of docs/."""
    if page.file.src_uri.startswith('commands/'):
        return markdown
    source = next((name for name, path in OUTSIDE.items() if path == page.file.src_uri), 'docs/' + page.file.src_uri)
    folder = (ROOT / source).parent
    inside = {file.src_uri for file in files}
    here = Path(page.file.src_uri).parent

    def in_site(path):
        """Returns the path from this page; None for a file that the site lacks."""
        place = os.path.relpath((folder / path).resolve(), ROOT)
        target = OUTSIDE.get(place, place.removeprefix('docs/'))
        return os.path.relpath(target, here) if target in inside else None

    def link(match):
        label, path, anchor = match['label'], match['path'], match['anchor'] or ''
        if re.match(r'[a-z]+:', path) or not path:
            return match[0]
        if target := in_site(path):
            return f'{label}({target}{anchor})'
        if REPOSITORY:
            return f'{label}({REPOSITORY}/blob/main/{os.path.relpath((folder / path).resolve(), ROOT)}{anchor})'
        return label[1:-1] if not label.startswith('!') else match[0]

    def attribute(match):
        path, hash_, anchor = match[2].partition('#')
        return f'{match[1]}="{(in_site(path) if not re.match("[a-z]+:", path) else None) or path}{hash_}{anchor}"'

    def rewritten(text):
        text = with_themes(with_lists_apart(text))
        text = LINK.sub(link, text)
        return re.sub(r'\b(src|href)="([^"]+)"', attribute, text)
    return ''.join(part if part.lstrip().startswith('```') else rewritten(part) for part in FENCED.split(markdown))
