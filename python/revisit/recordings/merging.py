"""Scans of several LiDARs of a robot, merged into one scan per sweep."""

from pathlib import Path

import numpy as np

from revisit.errors import InputError, UsageError
from revisit.poses import are_rigid, rigid
from revisit.recordings.recording import Scan

MAX_GAP = 0.1
"""Maximum time between merged scans [s]."""


def read_extrinsics(file):
    """Returns name -> T_body_sensor of lines `NAME x y z qx qy qz qw`. Text after a # is ignored."""
    poses = {}
    try:
        lines = Path(file).read_text(encoding='utf-8-sig').splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f'{file}: cannot be read: {error}') from None
    for number, line in enumerate(lines, 1):
        words = line.partition('#')[0].replace(',', ' ').split()
        if not words:
            continue
        try:
            values = np.array([float(word) for word in words[1:]])
        except ValueError:
            values = np.empty(0)
        if len(values) != 7 or not are_rigid(pose := rigid(values[None, :3], values[None, 3:]))[0]:
            raise InputError(f'{file}:{number}: expected a topic or frame_id and its pose, NAME x y z qx qy qz qw, found {line[:80]!r}')
        if (name := words[0].lstrip('/')) in poses:
            raise InputError(f'{file}:{number}: a second pose of {words[0]}')
        poses[name] = pose[0]
    return poses


def poses_by_file(file, topics):
    """Returns T_first_sensor of each topic."""
    poses, found = read_extrinsics(file), []
    for topic in topics:
        pose = poses.get(topic.name.lstrip('/'), poses.get(topic.frame_id))
        if pose is None:
            raise UsageError(f'{file}: no line for {topic.name} (frame_id {topic.frame_id}); it has {", ".join(poses) or "none"}')
        found.append(pose)
    return [np.linalg.inv(found[0]) @ pose for pose in found]


def poses_by_tree(path, tree, topics):
    """Returns T_first_sensor of each topic. tree: frame -> (parent, T_parent_frame)."""
    def ancestors(frame):
        """Returns ancestor -> T_ancestor_frame, from the frame to its root."""
        chain, T = {}, np.eye(4)
        while frame not in chain:
            chain[frame] = T
            if frame in tree:
                frame, T = tree[frame][0], tree[frame][1] @ T
        return chain

    first, poses = ancestors(topics[0].frame_id), []
    for topic in topics:
        own = ancestors(topic.frame_id)
        common = next((frame for frame in own if frame in first), None)
        if common is None:
            raise UsageError(f'{path}: its TF does not relate the frame_id {topic.frame_id} of {topic.name} to {topics[0].frame_id}; give '
                             'both poses with --extrinsics FILE, lines `NAME x y z qx qy qz qw`')
        poses.append(np.linalg.inv(first[common]) @ own[common])
    return poses


def together(parts, poses, stamp):
    """Reads scans. Returns their points in the first sensor's frame, and times relative to its stamp.

    A scan without times has the time of its own stamp. If no scan has times and all have one stamp, there are none.
    """
    read = [(*part.read(), pose, part.time - stamp) for part, pose in zip(parts, poses)]
    timed = any(times is not None or after for _, times, _, after in read)
    all_points, all_times = [], []
    for points, times, pose, after in read:
        points = points[:, :3]
        kept = points.any(1)  # the origin is no return
        all_points.append((points[kept] @ pose[:3, :3].T + pose[:3, 3]).astype(np.float32))
        all_times.append(np.full(len(all_points[-1]), after) if times is None else after + times[kept].astype(np.float64))
    return np.concatenate(all_points), np.concatenate(all_times).astype(np.float32) if timed else None


def merged(path, topics, poses):
    """Yields scans of the first topic, each with those of the others that are nearer to it than to its neighbors."""
    def until(k, end):
        """Yields the next scans of a topic before a time."""
        while (scan := waiting[k]) is not None and scan.time < end:
            waiting[k] = next(streams[k], None)
            yield scan

    streams = [topic.scans() for topic in topics]
    waiting, met, frame = [next(stream, None) for stream in streams], {0}, 0
    first_times = [scan and scan.time for scan in waiting]
    while (here := waiting[0]) is not None:
        waiting[0] = after = next(streams[0], None)
        parts = [(here, 0)]
        for k in range(1, len(topics)):
            near = [scan for scan in until(k, np.inf if after is None else (here.time + after.time) / 2)
                    if abs(scan.time - here.time) <= MAX_GAP]
            parts += [(scan, k) for scan in near]
            met |= {k} if near else set()
        yield Scan(frame, here.time, None, lambda parts=parts, here=here: together(
            [scan for scan, _ in parts], [poses[k] for _, k in parts], here.time), f'{path}, frame {frame}')
        frame += 1
    for k in set(range(len(topics))) - met:
        raise InputError(f'{path}: no scan of {topics[k].name} is within {MAX_GAP} s of one of {topics[0].name}; their first times are '
                         f'{first_times[k]:.3f} and {first_times[0]:.3f}. Synchronize the clocks, or leave the topic out')
