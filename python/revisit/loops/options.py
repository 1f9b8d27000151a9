"""The options of revisit-loops."""

import argparse
import os

from revisit import maps, poses, recognition
from revisit.errors import UsageError
from revisit.recordings import READERS

EXAMPLES = """\
examples:
  revisit-loops drive.bag                                              # ROS 1; the only topic of PointCloud2
  revisit-loops drive_ros2/ --topic /ouster/points -o loops.csv        # ROS 2: a folder, .db3 or .mcap
  revisit-loops drive.mcap --poses kiss_icp_tum.txt --pose-frame lidar --exclusion metres=50
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
        description='Places seen before, found online: every scan is described, compared with what was there before it,\n'
                    'printed as a line when it is recognised, and added. docs/SCANS.md has what is read.')
    parser.add_argument('data', metavar='DATA', help='a bag, packets, a data set, or a folder of scans')
    data = parser.add_argument_group('data')
    data.add_argument('--reader', choices=[reader.name for reader in READERS], help='default: detected')
    data.add_argument('--topic', help='of a bag that has several of PointCloud2')
    data.add_argument('--sequence', default='', help='of a data set with several: 00, scene-0061, Ouster')
    data.add_argument('--meta', metavar='FILE', help="of Ouster's packets (default: the .json file beside them)")
    data.add_argument('--every', type=positive, default=1, metavar='N', help='only frames whose number is a multiple of N')
    data.add_argument('--sensor', default='auto', help='whose ring model is taken: '
                      f'{", ".join(recognition.shipped_ring_models())} (default auto: from the first scans)')
    data.add_argument('--mount', default='', metavar='R,P,Y,X,Y,Z', help='roll, pitch, yaw [deg] and shift [m] that take points to '
                      'x forward, y left, z up, e.g. 180,0,0,0,0,0 for a sensor upside down')
    data.add_argument('--ring', metavar='FILE', help='a ring model that `revisit learn` wrote, instead')
    where = parser.add_argument_group('poses')
    where.add_argument('--poses', metavar='FILE', help='of the scans (default: those of the data set)')
    where.add_argument('--pose-format', choices=poses.FORMATS, help='default: detected')
    where.add_argument('--pose-frame', choices=poses.FRAMES,
                       help='lidar: z is up in the world; camera: x to the right, y down, z forward. Needed with --poses')
    where.add_argument('--calib', metavar='FILE', help='T_body_lidar when the poses are not the lidar\'s: calib.txt of KITTI, '
                       'or 3 x 4 numbers (default with camera: one that looks ahead)')
    where.add_argument('--max-gap', type=float, default=0.1, metavar='SECONDS',
                       help='between a scan and its pose (default %(default)s)')
    where.add_argument('--no-deskew', action='store_true', help='leave in points what the motion during a scan did to them. By '
                       'default it is taken out where the recording has times of points, and scans have times and poses')
    where.add_argument('--poses-out', metavar='FILE', help='TUM: where the recognised scans were, by the poses given')
    loops = parser.add_argument_group('loops')
    loops.add_argument('--threshold', type=float, metavar='S', help='accept loops from this score on: similarity plus share of '
                       'inliers of a registered one (default: from where --sure is reached)')
    loops.add_argument('--sure', type=float, metavar='P', help='share of accepted loops that are to be right (default 0.99, or 0.95 '
                       'with --no-verify), as far as the calibration of the map or the library holds')
    loops.add_argument('--exclusion', default='frames=50', metavar='KIND=N', help='recent scans of the drive that are not compared: '
                       'frames=50 (default), seconds=30, metres=50 or none')
    loops.add_argument('--keyframes', default='all', metavar='RULE', help='scans that are stored; all are compared: all (default), '
                       'metres=1 (by poses) or similarity=0.9 (less similar to the last one stored)')
    loops.add_argument('--local-map', type=float, default=0, metavar='METRES', help='describe and register what was seen on the last '
                       'METRES by the poses, 1 to 200, instead of a scan alone: for sensors with a gap, or few points')
    loops.add_argument('--verify', action=argparse.BooleanOptionalAction, default=None, help='register the most similar places '
                       'by GICP: where the scan was; how well points fit counts as much as the similarity (default)')
    loops.add_argument('--first-stretch', type=positive, default=128, metavar='N', help='places that the mean ring is learnt from '
                       '(default %(default)s)')
    loops.add_argument('--map', metavar='FILE', help='where places are kept; made when missing (default: nowhere)')
    loops.add_argument('--no-clouds', action='store_true', help='store no points of places (some 20 kB each): loops are not registered')
    loops.add_argument('--drive', metavar='NAME', help='name of this drive in the map (default: the name of the data)')
    loops.add_argument('--threads', type=positive, default=len(os.sched_getaffinity(0)), metavar='N', help='of one scan')
    out = parser.add_argument_group('output')
    out.add_argument('--format', choices=['csv', 'jsonl'], default='csv', help='one line per loop (default csv)')
    out.add_argument('--all', action='store_true', help='a line for every scan, not only for accepted loops')
    out.add_argument('-o', '--output', metavar='FILE', help='for the loops (default: standard output)')
    out.add_argument('--g2o', metavar='FILE', help='a pose graph: poses, and registered loops')
    out.add_argument('--tum', metavar='FILE', help='a trajectory: where registered loops say that the sensor was')
    out.add_argument('--report', metavar='FILE.html', help='the page of `revisit report`, which must be on PATH')
    out.add_argument('--plot', metavar='FILE.png', help='a picture (needs matplotlib)')
    out.add_argument('--rerun', nargs='?', const='', metavar='FILE.rrd', help='a live view, or a file for one (needs rerun-sdk)')
    out.add_argument('-q', '--quiet', action='store_true', help='only errors')
    return parser


def parse(arguments):
    o = make_parser().parse_args(arguments)
    maps.check_exclusion(o.exclusion)
    if o.mount:
        recognition.parse_mount(o.mount)
    if o.poses and not o.pose_frame:
        raise UsageError('--poses: say whose axes they have with --pose-frame: lidar (z up; KISS-ICP, LIO, GNSS) or camera '
                         "(z forward, y down; KITTI's poses)")
    for name in ('pose_format', 'pose_frame', 'calib'):
        if getattr(o, name) and not o.poses:
            raise UsageError(f'--{name.replace("_", "-")} is about --poses, which is not given')
    if o.sure is not None and not 0 < o.sure < 1:
        raise UsageError(f'--sure: expected more than 0, less than 1, found {o.sure:g}')
    if o.threshold is not None and o.sure is not None:
        raise UsageError('--threshold and --sure: one of the two')
    for name in ('verify', 'g2o', 'tum'):
        if getattr(o, name) and (o.verify is False or o.no_clouds):
            raise UsageError(f'--no-{"verify" if o.verify is False else "clouds"}: --{name} needs registered loops; give one of the two')
    if not (o.max_gap >= 0):
        raise UsageError(f'--max-gap: expected a number of seconds, found {o.max_gap}')
    return o
