"""MapClosures (Gupta et al., ICRA 2024; PyPI `map-closures`) on the keyframes of a drive.

As in the authors' pipeline, a local map ends when the sensor is `length` meters from its start, and is compared with all but the
previous three. Three things differ: poses are the drive's, KISS-ICP's only if it has none, which favors MapClosures. The next local
map starts with the scans of this one, because older scans of a place would be found by odometry. A closure (T, inliers) gives the pose
of a keyframe in the earlier map; the nearest keyframe there, within 5 m, is the answer, the inliers its score.
"""

import sys

import numpy as np
from drives import RADIUS

RANGE = 100
"""Maximum range of KISS-ICP [m]."""


def odometry(files, read_scan):
    """Returns T_world_sensor by KISS-ICP, relative to its origin."""
    from kiss_icp.config import KISSConfig
    from kiss_icp.kiss_icp import KissICP
    config = KISSConfig()
    config.mapping.voxel_size, config.data.max_range, config.data.deskew, config.registration.max_num_threads = 1.0, RANGE, False, 1
    icp, poses = KissICP(config), []
    for file in files:
        icp.register_frame(read_scan(file)[:, :3].astype(float), np.zeros(0))
        poses.append(icp.last_pose.copy())
    return np.array(poses)


class LocalMap:
    """Keyframes first to last - 1, and the pose of the origin."""

    def __init__(self, pose, first):
        self.pose, self.first, self.last = pose, first, first


def closures(drive, length):
    from map_closures.config import MapClosuresConfig
    from map_closures.map_closures import MapClosures
    from map_closures.voxel_map import VoxelMap
    from revisit.datasets import read_scan
    config = MapClosuresConfig()
    finder, voxels = MapClosures(config), VoxelMap(config.density_map_resolution, RANGE)
    starts = drive.starts
    poses = drive.poses
    if poses is None:
        edges = [*starts, len(drive.files)]
        poses = np.concatenate([odometry(drive.files[a:b], read_scan) for a, b in zip(edges, edges[1:])])
    maps, answers, candidates = [LocalMap(poses[0], 0)], {}, dict(zip(drive.queries, drive.stored[drive.candidates - 1]))

    def finish(end):
        maps[-1].last = end
        found = finder.get_closures(len(maps) - 1, voxels.point_cloud())
        for closure in found:
            answer_by(closure, config.inliers_threshold)

    def integrate(i):
        here = np.linalg.inv(maps[-1].pose) @ poses[i]
        voxels.integrate_frame(read_scan(drive.files[i])[:, :3], here)
        return here

    def begin(first, seen_from):
        maps.append(LocalMap(poses[first - 1 if seen_from < first else first], first))
        voxels.clear()
        for i in range(seen_from, first):
            integrate(i)

    def answer_by(closure, threshold):
        earlier, later = maps[closure.source_id], maps[closure.target_id]
        around = slice(maps[max(0, closure.source_id - 1)].first, maps[min(len(maps) - 1, closure.source_id + 1)].last)
        places = np.arange(len(poses))[around]
        at = (np.linalg.inv(earlier.pose) @ poses[places])[:, :3, 3]
        T_earlier_later = np.linalg.inv(np.asarray(closure.pose))
        for query in range(later.first, later.last):
            near = places <= candidates.get(query, -1)
            if not near.any():
                continue
            here = (T_earlier_later @ np.linalg.inv(later.pose) @ poses[query])[:3, 3]
            distance = np.where(near, np.linalg.norm(at - here, axis=1), np.inf)
            if distance.min() < RADIUS and closure.number_of_inliers > answers.get(query, (0, 0))[1]:
                answers[query] = (int(places[distance.argmin()]), closure.number_of_inliers, closure.number_of_inliers > threshold)

    for i in range(len(drive.files)):
        if i in starts and i:
            finish(i)
            begin(i, i)
        here = integrate(i)
        if np.linalg.norm(here[:3, 3]) > length:
            finish(i + 1)
            begin(i + 1, maps[-1].first)
    finish(len(drive.files))
    print(f'{len(maps)} local maps, {len(answers)} keyframes answered', file=sys.stderr)
    return [answers.get(query, (None, 0, False)) for query in drive.queries]
