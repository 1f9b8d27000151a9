"""The page of figures, curves, maps and pictures that `revisit report` makes of runs of `revisit eval` and of loops."""

import os

from revisit import program

__all__ = ['write_report']


def write_report(runs, page: str | os.PathLike = 'report.html', *, title: str | None = None,
                 markdown: str | os.PathLike | None = None, queries: int | None = None, force: bool = False):
    """Writes one HTML file, which needs no network.

    runs: folders of `revisit eval` and `revisit robustness`, experiments, .jsonl files of `revisit loops`; one or several.
    queries: shown with range images, of each kind: wrong, missed, right.
    force: replaces files that are not reports.
    Raises UnsupportedError without the program (revisit.program), InputError for what is no run.
    """
    given = {'--title': title, '--markdown': markdown, '--queries': queries}
    options = [word for name, value in given.items() if value is not None for word in (name, value)]
    folders = [runs] if isinstance(runs, (str, os.PathLike)) else list(runs)
    program.run('report', *folders, '-o', page, *options, *['--force'] * force)
