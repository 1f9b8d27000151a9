"""Reader of nuScenes: keyframes and sweeps of LIDAR_TOP, with poses if the JSON tables of v1.0-* exist. Needs no devkit."""

import json

import numpy as np

from revisit.errors import InputError, UsageError
from revisit.poses import are_rigid, rigid
from revisit.recordings.data_sets import record
from revisit.recordings.recording import Scan, read_records, recording_of

POINT = record(*['f4'] * 5)
"""x, y, z, intensity, ring"""
LIDAR = 'LIDAR_TOP'
ENDING = '.pcd.bin'


def tables_in(path):
    return sorted(folder for folder in path.glob('v1.0-*') if (folder / 'sample_data.json').is_file())


def detects(path):
    return bool(tables_in(path)) or next(path.glob(f'*{ENDING}'), None) is not None or any(
        (path / part / LIDAR).is_dir() for part in ('samples', 'sweeps'))


def load(file):
    try:
        return json.loads(file.read_bytes())
    except (OSError, ValueError, RecursionError) as error:
        raise InputError(f'{file}: {error}') from None


def pose_of(row):
    w, x, y, z = row['rotation']
    pose = rigid(np.array([row['translation']], np.float64), np.array([[x, y, z, w]], np.float64))
    if not are_rigid(pose)[0]:
        raise ValueError(f'expected a rigid transform (rotation, translation), found {row}')
    return pose[0]


def file_of(path, name):
    """Returns the path of a file named in a table. Raises ValueError if it is outside of the data set."""
    if name.startswith('/') or '..' in name.split('/'):
        raise ValueError(f'expected the name of a file of the data set, found {name!r}')
    return path / name


def scan_of(frame, file, time, pose):
    return Scan(frame, time, pose, lambda: read_records(file, POINT), str(file))


def open_nuscenes(path, sequence):
    tables = tables_in(path)
    if not tables:
        return without_tables(path)
    try:
        return from_tables(path, tables, sequence)
    except (AttributeError, KeyError, OverflowError, TypeError, ValueError) as error:
        if isinstance(error, UsageError):
            raise
        raise InputError(f'{tables[0]}: expected tables of nuScenes: {type(error).__name__} {error}') from None


def from_tables(path, tables, sequence):
    scenes = {scene['name']: (folder, scene) for folder in tables for scene in load(folder / 'scene.json')}
    name = f'scene-{sequence.zfill(4)}' if sequence.isdigit() else sequence
    if name not in scenes and (sequence or len(scenes) != 1):
        raise UsageError(f'{path}: choose the scene with --sequence: {", ".join(sorted(scenes)) or "none found"}')
    folder, scene = scenes[name or next(iter(scenes))]
    samples = {row['token'] for row in load(folder / 'sample.json') if row['scene_token'] == scene['token']}
    rows = [row for row in load(folder / 'sample_data.json')
            if row['sample_token'] in samples and f'/{LIDAR}/' in row['filename']]
    if not rows:
        raise InputError(f'{folder}: no scans of {LIDAR} in {scene["name"]}')
    sensors = {row['token']: row for row in load(folder / 'calibrated_sensor.json')}
    places = {row['token']: row for row in load(folder / 'ego_pose.json')}

    def pose(row):
        T_world_car, T_car_lidar = pose_of(places[row['ego_pose_token']]), pose_of(sensors[row['calibrated_sensor_token']])
        return T_world_car @ T_car_lidar

    rows.sort(key=lambda row: row['timestamp'])
    return recording_of(scene['name'], [scan_of(i, file_of(path, row['filename']), row['timestamp'] * 1e-6, pose(row))
                                        for i, row in enumerate(rows)])


def without_tables(path):
    """Reads the folder itself, or samples/LIDAR_TOP and sweeps/LIDAR_TOP, ordered by the time in file names [us]."""
    folders = [folder for folder in (path, path / 'samples' / LIDAR, path / 'sweeps' / LIDAR) if folder.is_dir()]
    files = []
    for file in (file for folder in folders for file in folder.glob(f'*{ENDING}')):
        stamp = file.name.removesuffix(ENDING).rpartition('__')[2]
        if not stamp.isdecimal():
            raise InputError(f'{file}: expected a name that ends in __MICROSECONDS{ENDING}')
        files.append((int(stamp), file))
    if not files:
        raise InputError(f'{path}: expected nuScenes (v1.0-*/sample_data.json or *{ENDING}), found none')
    return recording_of(path.name, [scan_of(i, file, stamp * 1e-6, None) for i, (stamp, file) in enumerate(sorted(files))])
