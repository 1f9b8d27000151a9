"""HTML report of runs of `revisit eval` and `revisit loops`, made by `revisit report`."""

import os

from revisit import program

__all__ = ['write_report']


def write_report(runs, output: str | os.PathLike = 'report.html', *, title: str | None = None,
                 markdown: str | os.PathLike | None = None, queries: int | None = None, force: bool = False):
    """Writes one self-contained HTML file.

    runs: one or several folders of `revisit eval`, .jsonl files of `revisit loops`, or .csv files of your own matches.
    queries: number of queries shown with range images, for each of: incorrect, missed, correct.
    force: overwrite files that are not reports.
    Raises UnsupportedError if the program is missing (revisit.program), InputError if a folder or file is not a run.
    """
    given = {'--title': title, '--markdown': markdown, '--queries': queries}
    options = [word for name, value in given.items() if value is not None for word in (name, value)]
    folders = [runs] if isinstance(runs, (str, os.PathLike)) else list(runs)
    program.run('report', *folders, '-o', output, *options, *['--force'] * force)
