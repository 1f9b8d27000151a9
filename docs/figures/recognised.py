#!/usr/bin/env python3
"""Draws recognised.png: a range image above, a map with the recognised places below.

  docs/figures/recognised.py RUN IMAGE OUTPUT.png     RUN: a folder of `revisit eval`, IMAGE: a PNG of `revisit image`

Needs matplotlib (Debian: python3-matplotlib). docs/SIMULATION.md has the commands before this one.
"""

import argparse
import csv
from pathlib import Path

import matplotlib

matplotlib.use('Agg')
import matplotlib.pyplot as plt

KINDS = {  # colour, size, legend
    'recognised': ('#1a7f37', 16, 'recognised'),
    'wrong': ('#cf222e', 16, 'matched with another place'),
    'missed': ('#bf8700', 16, 'seen before, not recognised'),
}


def read(file):
    with file.open() as lines:
        return list(csv.DictReader(lines))


def kind_of(query):
    if query['accepted'] == '1':
        return 'recognised' if query['true'] == '1' else 'wrong'
    return 'missed' if query['positive'] == '1' else None


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('run', type=Path)
    parser.add_argument('image', type=Path)
    parser.add_argument('output', type=Path)
    arguments = parser.parse_args()

    place = {row['frame']: (float(row['x']), float(row['z'])) for row in read(arguments.run / 'scans.csv')}
    queries = [row for row in read(next(arguments.run.glob('loops_*.csv'))) if row['rank'] == '1']
    figure, (top, below) = plt.subplots(2, 1, figsize=(10, 7.6), height_ratios=(1, 5.2), layout='constrained')
    pixels = plt.imread(arguments.image)
    top.imshow(pixels, cmap='gray', aspect='auto', extent=(180, -180, -25, 3), interpolation='antialiased')
    top.set(xticks=range(180, -181, -90), yticks=(-25, 3), xlabel='azimuth from the principal direction [deg]', ylabel='elevation [deg]',
            title='One scan: range image, dark is near')

    below.plot(*zip(*place.values()), color='#8c959f', linewidth=1, zorder=1)
    for kind, (colour, size, legend) in KINDS.items():
        chosen = [query for query in queries if kind_of(query) == kind]
        if kind == 'wrong':
            for query in chosen:
                below.plot(*zip(place[query['query_index']], place[query['match_index']]), color=colour, linewidth=0.5,
                           alpha=0.5, zorder=2)
        below.scatter(*zip(*(place[query['query_index']] for query in chosen)), s=size, color=colour, zorder=3,
                      label=f'{legend} ({len(chosen)})')
    below.set(aspect='equal', xlabel='x [m]', ylabel='z [m]', title='A drive past places seen before, each scan asked alone')
    below.legend(loc='best', frameon=False)
    for axes in (top, below):
        axes.spines[['top', 'right']].set_visible(False)
    figure.savefig(arguments.output, dpi=110)


if __name__ == '__main__':
    main()
