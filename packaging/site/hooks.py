"""Hooks of mkdocs: pages from outside of docs/, a page for each command, and links to files that are not pages."""

import os
import re
import subprocess
from pathlib import Path

from mkdocs.structure.files import File

ROOT = Path(__file__).resolve().parents[2]
OUTSIDE = {'README.md': 'overview.md', 'HACKING.md': 'HACKING.md', 'CHANGELOG.md': 'CHANGELOG.md'}
REPOSITORY = os.environ.get('REVISIT_REPOSITORY', '')  # address of the sources, as https://github.com/NAME/revisit
PROGRAM = os.environ.get('REVISIT_PROGRAM', str(ROOT / 'build' / 'release' / 'tools' / 'revisit'))
COMMAND = re.compile(r'^  ([a-z][a-z-]+) {2,}\S', re.M)


def help_of(*words):
    return subprocess.run([PROGRAM, *words, '--help=all'] if words else [PROGRAM, '--help'], check=True, capture_output=True, text=True).stdout


def commands():
    """Yields the words of each command and its help: `net` and `map` have commands of their own."""
    for name in COMMAND.findall(help_of()):
        text = help_of(name)
        yield [name], text
        if re.search(rf'^Usage: revisit {name} COMMAND', text, re.M):
            for verb in COMMAND.findall(text):
                yield [name, verb], help_of(name, verb)


def command_pages():
    """Returns {path: text}."""
    return {f'commands/{"-".join(words)}.md': f'# revisit {" ".join(words)}\n\n```text\n{text.rstrip()}\n```\n' for words, text in commands()}


def on_config(config):
    config['pages_of_commands'] = command_pages()
    listed = [{f'revisit {Path(path).stem.replace("-", " ", 1)}': path} for path in config['pages_of_commands']]

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
    for page, text in config['pages_of_commands'].items():
        files.append(File.generated(config, page, content=text))
    return files


def on_page_markdown(markdown, page, config, files):
    """Relative links are those of the tree; in the site README, HACKING and CHANGELOG are pages beside those of docs/."""
    source = next((name for name, path in OUTSIDE.items() if path == page.file.src_uri), 'docs/' + page.file.src_uri)
    folder = (ROOT / source).parent
    pages = {file.src_uri for file in files}
    here = Path(page.file.src_uri).parent

    def target(match):
        label, path, anchor = match['label'], match['path'], match['anchor'] or ''
        if re.match(r'[a-z]+:', path) or not path:
            return match[0]
        place = os.path.relpath((folder / path).resolve(), ROOT)
        inside = OUTSIDE.get(place, place.removeprefix('docs/'))
        if inside in pages:
            return f'{label}({os.path.relpath(inside, here)}{anchor})'
        if REPOSITORY:
            return f'{label}({REPOSITORY}/blob/main/{place}{anchor})'
        return label[1:-1] if not label.startswith('!') else match[0]
    if page.file.src_uri.startswith('commands/'):
        return markdown
    parts = re.split(r'(^```.*?^```$)', markdown, flags=re.M | re.S)
    link = re.compile(r'(?P<label>!?\[[^\]]*\])\((?P<path>[^)#\s]*)(?P<anchor>#[^)\s]*)?\)')
    return ''.join(part if part.startswith('```') else link.sub(target, part) for part in parts)
