"""Shows the lines of `revisit loops --all --format jsonl`: a picture by matplotlib, or a view in Rerun, which may be live."""

import argparse
import json
import math
import sys

from revisit.errors import Error, InputError
from revisit.recordings.__main__ import add_options, open_given
from revisit.recordings.recording import package

MAX_POINTS = 20000
PART = 256
"""Elements per entity of a growing list, because an entity is logged again whenever it grows."""
EXAMPLES = """\
examples:
  python3 -m revisit.show loops.jsonl -o loops.png
  revisit loops drive.bag --all --format jsonl | python3 -m revisit.show - drive.bag     # live
"""


def plot(lines, file):
    """Plots a top-down map (x right, z up), or without poses the matched frame of each loop."""
    package('matplotlib', 'matplotlib', 'the plot').use('Agg')
    from matplotlib import pyplot
    figure, axes = pyplot.subplots(figsize=(7, 7), layout='constrained')
    lines = list(lines)
    loops = [line for line in lines if line.get('accepted')]
    if any('position' in line for line in lines):
        def ground(line, name='position'):
            at = line.get(name)
            return (at['x'], at['z']) if at else (math.nan, math.nan)
        axes.plot(*zip(*map(ground, lines)), '.-', color='lightgray', markersize=2, label='scans')
        for line in loops:
            axes.plot(*zip(ground(line), ground(line, 'match_position')), color='tab:green', linewidth=1)
        if loops:
            axes.plot(*zip(*map(ground, loops)), '.', color='tab:green', label='loop closures')
        axes.set_aspect('equal', adjustable='datalim')
        axes.set_xlabel('[m]')
        axes.set_ylabel('[m]')
    else:
        axes.plot([line['frame'] for line in loops], [line['match_frame'] for line in loops], '.', color='tab:green',
                  label='loop closures')
        axes.set_xlabel('frame')
        axes.set_ylabel('matched frame')
    axes.legend()
    axes.set_title(f'{len(loops)} loops')
    try:
        figure.savefig(file)
    except (OSError, ValueError) as error:
        raise Error(f'{file}: cannot be written: {error}') from None
    pyplot.close(figure)


def grower(log, name, make):
    elements = []

    def add(element):
        elements.append(element)
        part = (len(elements) - 1) // PART
        log(f'{name}/{part}', make(elements[part * PART:]))
    return add


def view(lines, scans, file):
    """Shows scores, path and loops in Rerun, and the points of `scans`. file: recording to write (.rrd); None: opens a window."""
    rr = package('rerun', 'rerun-sdk', 'the live view')
    rr.init('revisit', spawn=file is None)
    if file is not None:
        rr.save(file)
    rr.log('scan', rr.ViewCoordinates.FLU, static=True)
    rr.log('map', rr.ViewCoordinates.RDF, static=True)
    green = [0, 158, 115]
    path = grower(rr.log, 'map/path', lambda positions: rr.Points3D(positions, colors=[160, 160, 160]))
    loops = grower(rr.log, 'map/loops', lambda pairs: rr.LineStrips3D(pairs, colors=green))
    frames = grower(rr.log, 'frames', lambda pairs: rr.Points2D(pairs, colors=green))
    for line in lines:
        rr.set_time('frame', sequence=line['frame'])
        scan = next((scan for scan in scans if scan.frame == line['frame']), None)
        if scan is not None:
            points = scan.points()
            rr.log('scan', rr.Points3D(points[:: max(1, len(points) // MAX_POINTS), :3]))
        if 'score' in line:
            rr.log('score', rr.Scalars(line['score']))
        here, match = ([line[name][axis] for axis in 'xyz'] if name in line else None for name in ('position', 'match_position'))
        if here:
            path(here)
        if line.get('accepted'):
            frames([line['frame'], line['match_frame']])
            if here and match:
                loops([here, match])


def lines_of(file):
    """Yields the lines as they come."""
    for number, text in enumerate(file, 1):
        try:
            line = json.loads(text)
            line['frame']
        except (ValueError, KeyError, TypeError):
            raise InputError(f'{file.name}:{number}: expected a line of `revisit loops --format jsonl`, found {text[:60]!r}') from None
        yield line


def main(arguments=None) -> int:
    parser = argparse.ArgumentParser('python3 -m revisit.show', formatter_class=argparse.RawDescriptionHelpFormatter,
                                     description=__doc__, epilog=EXAMPLES)
    parser.add_argument('lines', metavar='LINES.jsonl', help='- reads standard input')
    parser.add_argument('data', metavar='DATA', nargs='?', help='recording of the lines, for the points in Rerun')
    add_options(parser)
    parser.add_argument('-o', '--output', metavar='FILE', help='picture of the loops (.png, .svg), or file for Rerun (.rrd; default: a window)')
    o = parser.parse_args(arguments)
    try:
        with sys.stdin if o.lines == '-' else open(o.lines, encoding='utf-8') as file:
            if o.output is None or o.output.endswith('.rrd'):
                view(lines_of(file), open_given(o).scans() if o.data else iter(()), o.output)
            else:
                plot(lines_of(file), o.output)
        return 0
    except KeyboardInterrupt:
        return 130
    except (Error, OSError) as error:
        print(f'revisit.show: {error}', file=sys.stderr)
        return getattr(error, 'code', 1)


if __name__ == '__main__':
    sys.exit(main())
