"""Recordings of a LiDAR: bags, packets, data sets and folders of scans, one scan after another.

    for scan in open_recording('drive.bag').scans():
        points = scan.points()
"""

from pathlib import Path

from revisit.errors import InputError, UsageError
from revisit.recordings import bags, data_sets, folders, kitti_360, nuscenes, packets
from revisit.recordings.recording import Options, Reader, Recording, Scan

__all__ = ['READERS', 'Options', 'Reader', 'Recording', 'Scan', 'open_recording']

READERS = [
    Reader('rosbag', bags.detects, bags.open_bag, ('topic',)),
    Reader('ouster', packets.detects_ouster, packets.open_ouster, ('meta',)),
    Reader('velodyne', packets.detects_velodyne, packets.open_velodyne),
    Reader('nuscenes', nuscenes.detects, nuscenes.open_nuscenes, ('sequence',)),
    Reader('kitti360', kitti_360.detects, kitti_360.open_kitti_360, ('sequence',)),
    Reader('helipr', data_sets.detects_helipr, data_sets.open_helipr, ('sequence',)),
    Reader('mulran', data_sets.detects_mulran, data_sets.open_mulran),
    Reader('nclt', data_sets.detects_nclt, data_sets.open_nclt),
    Reader('npy', folders.detects_npy, folders.open_npy),
    Reader('kitti', folders.detects, folders.open_scans, ('sequence',)),
]
"""In the order they are asked. The last takes what is left: KITTI's layout, and folders of .bin, .pcd and .ply files."""


def open_recording(path, *, format=None, topic=None, sequence='', meta=None) -> Recording:
    """What is at `path`. It is told by looking unless `format` names a reader.

    topic: of a bag; needed when it holds several of PointCloud2.
    sequence: of a data set that has several (KITTI: 00, nuScenes: scene-0061, HeLiPR: Ouster).
    meta: the metadata of Ouster packets (default: the .json file beside them).
    Raises InputError naming the path, Error when a package is missing, saying which.
    """
    path = Path(path)
    if not path.exists():
        raise InputError(f'{path}: there is no such file or folder')
    if path.name in ('', '..'):  # the drive is named after the folder, and KITTI-360's poses are found by that name
        path = path.resolve()
    names = [reader.name for reader in READERS]
    if format is not None and format not in names:
        raise UsageError(f'format of the data: expected one of {", ".join(names)}, found {format!r}')
    options = Options(topic, str(sequence or ''), meta)
    for reader in READERS:
        if reader.name == format or (format is None and reader.detects(path)):
            for name, value in options._asdict().items():
                if value and name not in reader.takes:
                    raise UsageError(f'{path}: {name} {value}: {reader.name} data has none; leave it out')
            return reader.opens(path, options)
    raise InputError(f'{path}: not recognised: expected a bag (.bag, .db3, .mcap), packets (.pcap, .osf), or a folder')
