"""Options of revisit-loops."""

import argparse
import os

from revisit import maps, poses, recognition
from revisit.errors import UsageError
from revisit.recordings import READERS

EXAMPLES = """\
examples:
  revisit-loops drive.bag                                              # ROS 1; the only topic of PointCloud2
  revisit-loops drive_ros2/ --topic /ouster/points -o loops.csv        # ROS 2: a folder, .db3 or .mcap
  revisit-loops drive.mcap --poses kiss_icp_tum.txt --pose-frame lidar --exclusion meters=50
  revisit-loops KITTI --sequence 00 --report loops.html
  revisit-loops MulRan/KAIST01 --sensor ouster-os1-64 --map kaist.map --plot loops.png

exit codes: 0 ok; 1 failed; 2 usage; 3 input unreadable or malformed; 6 done, but some scans could not be
described; 130 interrupted (what was found is kept).
"""


def positive(text):
    value = int(text)
    if value < 1:
        raise ValueError
    return value


class Parser(argparse.ArgumentParser):
    """Raises if the help cannot be written, which argparse ignores."""

    def print_help(self, file=None):
        print(self.format_help(), end='', file=file, flush=True)


def make_parser():
    parser = Parser(
        'revisit-loops', formatter_class=argparse.RawDescriptionHelpFormatter, epilog=EXAMPLES,
        description='Detects loop closures online: describes every scan, compares it with the scans before it, prints a line\n'
                    'for a loop, and adds the scan. docs/BAGS.md lists the formats.')
    parser.add_argument('data', metavar='DATA', help='bag, packets, data set, or folder of scans')
    data = parser.add_argument_group('data')
    data.add_argument('--reader', choices=[reader.name for reader in READERS], help='reader of DATA (default: detected)')
    data.add_argument('--topic', help='topic of a bag with several of PointCloud2')
    data.add_argument('--sequence', default='', help='sequence of a data set that has several: 00, scene-0061, Ouster')
    data.add_argument('--meta', metavar='FILE', help="metadata of Ouster's packets (default: the .json file beside them)")
    data.add_argument('--every', type=positive, default=1, metavar='N', help='frame stride: only frame numbers that are multiples '
                      'of N (default %(default)s)')
    data.add_argument('--sensor', default='auto', help='sensor of the ring model: '
                      f'{", ".join(recognition.shipped_ring_models())} (default auto: from the first scans)')
    data.add_argument('--mount', default='', metavar='R,P,Y,X,Y,Z', help='roll, pitch, yaw [deg] and shift [m] that take points to '
                      'x forward, y left, z up, e.g. 180,0,0,0,0,0 for a sensor upside down (default: none)')
    data.add_argument('--ring', metavar='FILE', help='ring model of `revisit train` (default: the shipped model for the sensor)')
    where = parser.add_argument_group('poses')
    where.add_argument('--poses', metavar='FILE', help="poses of the scans (default: the data set's)")
    where.add_argument('--pose-format', choices=poses.FORMATS, help='format of --poses (default: detected)')
    where.add_argument('--pose-frame', choices=poses.FRAMES,
                       help='axes of --poses, which needs it: lidar (z up) or camera (x right, y down, z forward)')
    where.add_argument('--calib', metavar='FILE', help="T_body_lidar if the poses are not the lidar's: calib.txt of KITTI, "
                       'or 3 x 4 numbers (default with camera: a camera that looks ahead)')
    where.add_argument('--max-gap', type=float, default=0.1, metavar='SECONDS',
                       help='maximum time between a scan and its pose (default %(default)s)')
    where.add_argument('--no-deskew', action='store_true', help='no motion compensation of scans (default: if scans have times, '
                       'poses and times of points)')
    where.add_argument('--poses-out', metavar='FILE', help='TUM file of the poses given for the recognized scans')
    loops = parser.add_argument_group('loops')
    loops.add_argument('--threshold', type=float, metavar='S', help='minimum score of an accepted loop: similarity plus inlier ratio '
                       'if registered (default: from --target-precision)')
    loops.add_argument('--target-precision', type=float, metavar='P', help='fraction of accepted loops that are correct, 0 to 1, by '
                       'the calibration of the map or the library (default 0.99, or 0.95 without registration)')
    loops.add_argument('--exclusion', default='frames=50', metavar='KIND=N', help='recent scans of this drive that are not compared: '
                       'frames=50, seconds=30, meters=50 or none (default %(default)s)')
    loops.add_argument('--keyframes', default='all', metavar='RULE', help='stored scans: all, meters=1 (by poses) or similarity=0.9 '
                       '(to the last one stored); all are queries (default %(default)s)')
    loops.add_argument('--local-map', type=float, default=0, metavar='METERS', help='path length of the local map that replaces a '
                       'scan, 1 to 200, for sensors with a gap or few points; needs poses (default: the scan)')
    loops.add_argument('--verify', action=argparse.BooleanOptionalAction, default=None, help='registration of candidates by GICP, '
                       'which estimates the relative pose; the inlier ratio adds to the score (default: on)')
    loops.add_argument('--warmup', type=positive, default=128, metavar='N', help='distinct map entries that the map mean is estimated '
                       'from (default %(default)s)')
    loops.add_argument('--map', metavar='FILE', help='map file, created if missing (default: none)')
    loops.add_argument('--no-clouds', action='store_true', help='no points in the map, 20 kB per entry; loops are then not registered')
    loops.add_argument('--drive', metavar='NAME', help='name of this recording in the map (default: the name of the data)')
    loops.add_argument('--threads', type=positive, default=len(os.sched_getaffinity(0)), metavar='N', help='threads of one scan '
                       '(default: all cores)')
    out = parser.add_argument_group('output')
    out.add_argument('--format', choices=['csv', 'jsonl'], default='csv', help='format of the lines (default csv)')
    out.add_argument('--all', action='store_true', help='a line for every scan (default: only for accepted loops)')
    out.add_argument('-o', '--output', metavar='FILE', help='file of the lines (default: standard output)')
    out.add_argument('--g2o', metavar='FILE', help='pose graph of the poses and the registered loops')
    out.add_argument('--tum', metavar='FILE', help="trajectory of the sensor from registered loops, in the frame of the map's poses")
    out.add_argument('--report', metavar='FILE.html', help='page of `revisit report`, which must be on PATH')
    out.add_argument('--plot', metavar='FILE.png', help='picture of the loops (needs matplotlib)')
    out.add_argument('--rerun', nargs='?', const='', metavar='FILE.rrd', help='live view, or a file for one (needs rerun-sdk)')
    out.add_argument('-q', '--quiet', action='store_true', help='only errors')
    return parser


def parse(arguments):
    o = make_parser().parse_args(arguments)
    maps.check_exclusion(o.exclusion)
    if o.mount:
        recognition.parse_mount(o.mount)
    if o.poses and not o.pose_frame:
        raise UsageError('--poses: needs --pose-frame: lidar (z up; KISS-ICP, LIO, GNSS) or camera (z forward, y down; '
                         "KITTI's poses)")
    for name in ('pose_format', 'pose_frame', 'calib'):
        if getattr(o, name) and not o.poses:
            raise UsageError(f'--{name.replace("_", "-")}: needs --poses')
    if o.target_precision is not None and not 0 < o.target_precision < 1:
        raise UsageError(f'--target-precision: expected more than 0, less than 1, found {o.target_precision:g}')
    if o.threshold is not None and o.target_precision is not None:
        raise UsageError('--threshold: not with --target-precision; give one of the two')
    for name in ('verify', 'g2o', 'tum'):
        if getattr(o, name) and (o.verify is False or o.no_clouds):
            raise UsageError(f'--no-{"verify" if o.verify is False else "clouds"}: not with --{name}, which needs registered loops; '
                             'give one of the two')
    if not (o.max_gap >= 0):
        raise UsageError(f'--max-gap: expected a number of seconds, found {o.max_gap}')
    return o
