"""Readers of LiDAR recordings: bags, packets, data sets and folders of scans.

    for scan in open_recording('drive.bag').scans():
        points = scan.points()

The modules of this package are the READERS; open_recording() chooses one.
"""

from collections.abc import Sequence
from os import PathLike
from pathlib import Path

from revisit.errors import InputError, UsageError
from revisit.recordings import bags, data_sets, folders, kitti_360, las, nuscenes, packets
from revisit.recordings.recording import Reader, Recording, Scan, with_point_times

__all__ = ['READERS', 'Reader', 'Recording', 'Scan', 'open_recording']
READERS = [
    Reader('rosbag', bags.detects, bags.open_bag, takes_sequence=True),
    Reader('ouster', packets.detects_ouster, packets.open_ouster),
    Reader('velodyne', packets.detects_velodyne, packets.open_velodyne),
    Reader('las', las.detects, las.open_las),
    Reader('nuscenes', nuscenes.detects, nuscenes.open_nuscenes, takes_sequence=True),
    Reader('kitti360', kitti_360.detects, kitti_360.open_kitti_360, takes_sequence=True),
    Reader('helipr', data_sets.detects_helipr, data_sets.open_helipr, takes_sequence=True),
    Reader('mulran', data_sets.detects_mulran, data_sets.open_mulran),
    Reader('nclt', data_sets.detects_nclt, data_sets.open_nclt),
    Reader('npy', folders.detects_npy, folders.open_npy),
    Reader('kitti', folders.detects, folders.open_scans, takes_sequence=True),
]
"""Order of detection. The last accepts any folder: KITTI's layout, and .bin, .pcd and .ply files."""


def open_recording(path: str | PathLike[str], *, sequence: str = '', topics: str | Sequence[str] = '',
                   extrinsics: str | PathLike[str] | None = None, point_times: str = 'auto') -> Recording:
    """Opens the recording at `path` by the first reader that detects it.

    sequence: of a data set with several (KITTI: 00, nuScenes: scene-0061, HeLiPR: Ouster); TOPIC or TOPIC@FRAME_ID of a
    bag with several.
    topics: of a bag (comma-separated, or a sequence), merged into one scan per sweep, in the frame and at the stamps of the first.
    extrinsics: file of the sensors' poses, lines `NAME x y z qx qy qz qw`, NAME being a topic or frame_id (default: the bag's TF).
    point_times: unit of the times of points: auto, s, ms, us, ns, scan (0 to 1 of a scan), or none.
    Raises InputError with the path, Error with the name of a missing package.
    """
    path = Path(path)
    if not path.exists():
        raise InputError(f'{path}: no such file or folder')
    if not topics:
        if extrinsics:
            raise UsageError('extrinsics: expected the topics that they merge')
        return with_point_times(open_reader(path, sequence), point_times)
    if sequence or not bags.detects(path):
        raise UsageError(f'{path}: topics: expected a bag, and no sequence')
    return bags.open_merged(path, topics.split(',') if isinstance(topics, str) else list(topics), extrinsics, point_times)


def open_reader(path, sequence):
    if path.name in ('', '..'):  # the folder gives the drive's name, which locates KITTI-360's poses
        path = path.resolve()
    for reader in READERS:
        if reader.detects(path):
            if reader.takes_sequence:
                return reader.opens(path, str(sequence or ''))
            if sequence:
                raise UsageError(f'{path}: sequence {sequence}: not supported for {reader.name} data; remove it')
            return reader.opens(path)
    raise InputError(f'{path}: unknown format; expected a bag (.bag, .db3, .mcap), packets (.pcap, .osf), a cloud (.las, .laz), or a folder')
