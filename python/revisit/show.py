"""Shows the lines of `revisit loops --all --format jsonl` in Rerun, also live."""

import argparse
import json
import sys

from revisit.errors import Error, InputError
from revisit.recordings.__main__ import add_options, open_given
from revisit.recordings.recording import package

MAX_POINTS = 20000
PART = 256
"""Elements per entity of a growing list, because an entity is logged again whenever it grows."""
EXAMPLES = """\
examples:
  python3 -m revisit.show loops.jsonl drive.bag
  revisit loops drive.bag --all --format jsonl | python3 -m revisit.show - drive.bag     # live
"""


def grower(log, name, make):
    """Returns a function that adds an element to a list in the view."""
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
    views = rr.blueprint
    rr.send_blueprint(views.Blueprint(
        views.Horizontal(views.Spatial3DView(origin='map', name='path and loops'),
                         views.Vertical(views.Spatial3DView(origin='scan'), views.TimeSeriesView(origin='score'))),
        views.TimePanel(timeline='frame', play_state='following', state='collapsed'), collapse_panels=True))
    rr.log('scan', rr.ViewCoordinates.FLU, static=True)
    rr.log('map', rr.ViewCoordinates.FLU, static=True)
    green = [0, 158, 115]
    path = grower(rr.log, 'map/path', lambda positions: rr.Points3D(positions, colors=[160, 160, 160]))
    loops = grower(rr.log, 'map/loops', lambda pairs: rr.LineStrips3D(pairs, colors=green))
    for line in lines:
        rr.set_time('frame', sequence=line['frame'])
        scan = next((scan for scan in scans if scan.frame == line['frame']), None)
        if scan is not None:
            if scan.pose is not None and abs(scan.pose[1, 2]) > abs(scan.pose[2, 2]):  # KITTI's world
                rr.log('map', rr.ViewCoordinates.RDF, static=True)
            points = scan.points()
            rr.log('scan', rr.Points3D(points[:: max(1, len(points) // MAX_POINTS), :3]))
        if 'score' in line:
            rr.log('score', rr.Scalars(line['score']))
        here, match = ([line[name][axis] for axis in 'xyz'] if name in line else None for name in ('position', 'match_position'))
        if here:
            path(here)
        if line.get('accepted') and here and match:
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
    """The command `python3 -m revisit.show`. Returns its exit code."""
    parser = argparse.ArgumentParser('python3 -m revisit.show', formatter_class=argparse.RawDescriptionHelpFormatter,
                                     description=__doc__, epilog=EXAMPLES)
    parser.add_argument('lines', metavar='LINES.jsonl', help='- reads standard input')
    parser.add_argument('data', metavar='DATA', nargs='?', help='recording of the lines, for their points')
    add_options(parser)
    parser.add_argument('-o', '--output', metavar='FILE', help='file to write (.rrd; default: a window)')
    o = parser.parse_args(arguments)
    try:
        with sys.stdin if o.lines == '-' else open(o.lines, encoding='utf-8') as file:
            view(lines_of(file), open_given(o).scans() if o.data else iter(()), o.output)
        return 0
    except KeyboardInterrupt:
        return 130
    except (Error, OSError) as error:
        print(f'revisit.show: {error}', file=sys.stderr)
        return getattr(error, 'code', 1)


if __name__ == '__main__':
    sys.exit(main())
