#!/usr/bin/env python3
"""Checks the site of the documentation: every link within it leads to a file and, with #, to an element.

  tests/documents/site.py SITE                 a site that packaging/site/build.sh has built
  tests/documents/site.py --pages PROGRAM      builds the pages by mkdocs first; exit code 77 without mkdocs

Also reports Markdown that was not rendered: fences, tables and list items in a paragraph.
"""

import argparse
import os
import subprocess
import sys
import tempfile
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

ROOT = Path(__file__).resolve().parents[2]
API = 'api/'  # of a complete site; its pages are written by doxygen and pdoc
RAW = ('```', '| ---', '|---', '<!--')


class Page(HTMLParser):
    def __init__(self, file):
        super().__init__()
        self.ids, self.links, self.raw, self.open = set(), [], [], []
        self.feed(file.read_text(errors='replace'))

    def handle_starttag(self, tag, attributes):
        found = dict(attributes)
        self.ids |= {found[name] for name in ('id', 'name') if found.get(name)}
        self.links += [found[name] for name in ('href', 'src') if found.get(name)]
        if tag in ('p', 'code', 'script', 'style'):
            self.open.append(tag)

    def handle_endtag(self, tag):
        if self.open and self.open[-1] == tag:
            self.open.pop()

    def handle_data(self, text):
        if self.open[-1:] == ['p'] and text.lstrip().startswith(RAW):
            self.raw.append(text.strip()[:60])


def faults_of(site):
    pages = {}

    def page(file):
        if file not in pages:
            pages[file] = Page(file)
        return pages[file]
    for file in sorted(site.rglob('*.html')):
        name = file.relative_to(site)
        if file.name == '404.html':  # its links begin at the root of the server
            continue
        if not str(name).startswith(API):
            yield from (f'{name}: not rendered: {text}' for text in page(file).raw)
        for link in sorted(set(page(file).links)):
            parts = urlsplit(link)
            if parts.scheme or parts.netloc or link.startswith('javascript:'):
                continue
            target = Path(os.path.normpath(file.parent / unquote(parts.path))) if parts.path else file
            if target.is_dir():
                target /= 'index.html'
            if str(target.relative_to(site) if target.is_relative_to(site) else '..').startswith(API) and not (site / API).exists():
                continue
            if not target.exists():
                yield f'{name}: {link} leads nowhere'
            elif parts.fragment and target.suffix == '.html' and not parts.fragment.startswith(('only-', '__', 'nested-classes')):
                if unquote(parts.fragment) not in page(target).ids and parts.fragment not in page(target).ids:
                    yield f'{name}: {link}: {target.name} has no such element'


def mkdocs():
    for command in ([str(ROOT / 'build/site_venv/bin/mkdocs')], [sys.executable, '-m', 'mkdocs']):
        try:
            if subprocess.run([*command, '--version'], capture_output=True).returncode == 0:
                return command
        except OSError:
            pass
    return None


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('site', nargs='?', type=Path)
    parser.add_argument('--pages', metavar='PROGRAM')
    o = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix='revisit_site_') as folder:
        site = o.site or Path(folder)
        if o.pages:
            command = mkdocs()
            if command is None:
                print('skipped: mkdocs is missing; packaging/site/build.sh installs it into build/site_venv. documents.py checks the links of the Markdown pages')
                return 77
            subprocess.run([*command, 'build', '--strict', '--quiet', '-f', 'packaging/site/mkdocs.yml', '-d', site], cwd=ROOT, check=True,
                           env=os.environ | {'REVISIT_PROGRAM': os.path.abspath(o.pages), 'NO_MKDOCS_2_WARNING': '1'})
        faults = list(faults_of(site.resolve()))
    print('\n'.join([*faults, f'{len(faults)} faults']))
    return 1 if faults else 0


if __name__ == '__main__':
    sys.exit(main())
