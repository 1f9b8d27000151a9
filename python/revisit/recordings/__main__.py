"""Streams the scans of a recording to standard output, as `revisit` reads them (docs/reference/FORMATS.md)."""

import argparse
import json
import os
import sys

import numpy as np

from revisit.errors import Error, InputError
from revisit.recordings import Recording, Scan, open_recording

VERSION = 1
"""Of the format."""


def positive(text):
    value = int(text)
    if value < 1:
        raise ValueError
    return value


def add_options(parser):
    """Declares the options of open_recording()."""
    parser.add_argument('--sequence', default='', help='sequence of a data set that has several: 00, scene-0061, Ouster; TOPIC or TOPIC@FRAME_ID of a bag')
    parser.add_argument('--topics', default='', metavar='A,B', help='topics of a bag that are merged into one scan per sweep')
    parser.add_argument('--extrinsics', metavar='FILE', help='poses of the sensors: NAME x y z qx qy qz qw (default: the TF of the bag)')
    parser.add_argument('--point-times', default='auto', choices=('auto', 's', 'ms', 'us', 'ns', 'scan', 'none'),
                        help='unit of the times of points; scan: 0 to 1 of a scan (default: found)')


def open_given(o) -> Recording:
    return open_recording(o.data, sequence=o.sequence, topics=o.topics, extrinsics=o.extrinsics, point_times=o.point_times)


def write(out, content, *arrays):
    """Writes a line of JSON, which has no bytes that are not UTF-8, and the arrays."""
    line = json.dumps({name: value for name, value in content.items() if value is not None}, separators=(',', ':'), ensure_ascii=False)
    out.write(line.encode('utf-8', 'surrogateescape').decode('utf-8', 'replace').encode() + b'\n')
    for array in arrays:
        out.write(np.ascontiguousarray(array, '<f4'))
    out.flush()


def write_scan(out, scan: Scan, headers: bool):
    line = {'frame': scan.frame, 'time': scan.time, 'source': scan.source,
            'pose': None if scan.pose is None else [float(value) for value in scan.pose[:3].ravel()]}
    if headers:
        write(out, line | {'points': 0})
        return
    try:
        points, times = scan.read()
    except InputError as error:
        text = str(error)
        write(out, line | {'points': 0, 'error': text if text.startswith(scan.source) else f'{scan.source}: {text}'})
        return
    write(out, line | {'points': len(points), 'times': times is not None}, points[:, :3], *([] if times is None else [times]))


def stream(o, out, headers):
    if headers:
        o.point_times = 'none'
    recording = open_given(o)
    count = recording.count and -(-recording.count // o.every)
    write(out, {'revisit_scans': VERSION, 'name': recording.name, 'count': count, 'warnings': recording.warnings,
                'point_times': recording.point_times})
    for scan in recording.scans():
        if scan.frame % o.every == 0:
            write_scan(out, scan, headers)
    write(out, {'end': True})


def failed(out, text, code) -> int:
    """Writes the error into the stream, whose reader prints it."""
    try:
        write(out, {'error': text, 'code': code})
    except BrokenPipeError:  # the reader has exited
        os.dup2(os.open(os.devnull, os.O_WRONLY), out.fileno())  # for the rest of the buffer
    return code


def main(arguments=None, headers=False) -> int:
    """headers: leaves the points out, for a program that needs frames, times and poses only."""
    parser = argparse.ArgumentParser(
        'python3 -m revisit.recordings', description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter,
        epilog='example:\n  python3 -m revisit.recordings drive.pcap | revisit loops - > loops.csv')
    parser.add_argument('data', metavar='DATA', help='bag, packets, data set, or folder of scans')
    add_options(parser)
    parser.add_argument('--every', type=positive, default=1, metavar='N', help='only frame numbers that are multiples of N')
    o = parser.parse_args(arguments)
    if sys.stdout.isatty():
        parser.error('standard output is a terminal; pipe it into `revisit loops -`')
    out = os.fdopen(os.dup(sys.stdout.fileno()), 'wb')
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())  # packages may print
    try:
        stream(o, out, headers)
        return 0
    except KeyboardInterrupt:
        return failed(out, 'interrupted', 130)
    except (Error, OSError) as error:
        return failed(out, str(error), getattr(error, 'code', 1))
    except Exception as error:  # a bug here or in a package: reported in one line
        return failed(out, f'{type(error).__name__}: {" ".join(str(error).split())}', 1)


if __name__ == '__main__':
    sys.exit(main())
