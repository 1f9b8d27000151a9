#!/usr/bin/env python3
"""SLAM: odometry by KISS-ICP, loop closures by revisit, robust pose graph optimization by GTSAM.

  slam.py scans/ -o out                                    # .bin, .pcd or .ply files, KITTI's layout, data sets
  slam.py drive.bag --sequence /points -o out              # any recording of revisit.recordings
  slam.py town --simulate 600 -o out                       # simulates a drive first

Writes out/trajectory.tum (T_world_lidar of every scan, z up) and out/trajectory.png. If the recording has poses, prints the
trajectory error of odometry and of the corrected trajectory. If most loops contradict the odometry, it has diverged, and the exit code
is 5. Ctrl-C keeps results so far. Exit codes are those of `revisit`.
"""

import argparse
import sys
import time
from pathlib import Path

try:
    import gtsam
    import numpy as np
    from evo.core import geometry, metrics, trajectory
    from evo.tools.file_interface import write_tum_trajectory_file
    from kiss_icp.kiss_icp import KISSConfig, KissICP
    from matplotlib import rc
    from matplotlib.figure import Figure
    from revisit import LoopDetector, datasets, errors, open_map, poses, program, recordings
    from revisit.loops import recognize
except ImportError as error:
    sys.exit(f"slam: {error}; in the sources of revisit: pip install '.[slam]'")

GRAY = '#77808c'  # readable on white and on black
rc('axes', edgecolor=GRAY, labelcolor=GRAY)
rc('legend', frameon=False)
for group in ('text', 'xtick', 'ytick'):
    rc(group, color=GRAY)
TO_GTSAM = np.ix_([3, 4, 5, 0, 1, 2], [3, 4, 5, 0, 1, 2])  # GTSAM orders rotation before translation
DRIFT = np.radians([0.05, 0.05, 0.05, 1, 1, 1])  # standard deviation of odometry per meter: rotation [rad], translation 0.017 [m]


def with_progress(recording):
    for done, scan in enumerate(recording.scans()):
        if sys.stderr.isatty():
            print(f'\r{done} of {recording.count or "?"} scans', end='', file=sys.stderr, flush=True)
        yield scan


class Odometry:
    def __init__(self, max_range, deskew):
        self.deskew, self.previous_time = deskew, None
        self.kiss = KissICP(KISSConfig(data={'max_range': max_range, 'deskew': False}, mapping={'voxel_size': max_range / 100}))
        self.moved, self.chosen, self.seconds = [], [], 0.0

    def keyframes(self, scans, every):
        """Yields keyframes, `every` meters apart, with the poses of odometry."""
        for scan in scans:
            raw, times = scan.read()
            start = time.perf_counter()
            # Deskews to the middle of the scan. At other times, errors of the last motion would accumulate.
            middle = 0 if times is None else (times.min() + times.max()) / 2
            points = self.deskewed(raw, None if times is None else times - middle, scan.time)
            self.kiss.register_frame(points[:, :3].astype(np.float64), np.zeros(len(points)))
            points = self.deskewed(raw, times, scan.time)  # by the motion of this scan
            pose = self.kiss.last_pose.copy()
            if points is not raw:
                step = gtsam.Pose3.Logmap(gtsam.Pose3(self.kiss.last_delta)) / (scan.time - self.previous_time)
                pose = pose @ gtsam.Pose3.Expmap(-middle * step).matrix()
            self.previous_time = scan.time
            self.seconds += time.perf_counter() - start
            self.moved.append((scan._replace(read=None), pose))
            if not self.chosen or np.linalg.norm((pose - self.moved[self.chosen[-1]][1])[:3, 3]) >= every:
                self.chosen.append(len(self.moved) - 1)
                yield scan._replace(read=lambda points=points: (points, None), pose=pose)

    def deskewed(self, points, times, now):
        """Deskews by the last motion. KISS-ICP assumes that a scan fills the time between two scans, which may not hold."""
        if not self.deskew or times is None or None in (now, self.previous_time) or now <= self.previous_time:
            return points
        return datasets.deskew(points, times, self.kiss.last_delta, now - self.previous_time)


def optimized(guesses, loops):
    """Returns the optimized poses [n][4][4]. Uses a Huber kernel first, then a Cauchy kernel, which suppresses outliers.

    loops: tuples (place, query, Registration).
    """
    values = gtsam.Values()
    for i, pose in enumerate(guesses):
        values.insert(i, gtsam.Pose3(pose))
    for kernel in (gtsam.noiseModel.mEstimator.Huber.Create(3), gtsam.noiseModel.mEstimator.Cauchy.Create(3)):
        graph = gtsam.NonlinearFactorGraph()
        graph.add(gtsam.PriorFactorPose3(0, gtsam.Pose3(guesses[0]), gtsam.noiseModel.Isotropic.Sigma(6, 1e-3)))
        for i in range(1, len(guesses)):
            step = np.linalg.inv(guesses[i - 1]) @ guesses[i]
            sigmas = DRIFT * max(1, float(np.linalg.norm(step[:3, 3]))) ** 0.5
            graph.add(gtsam.BetweenFactorPose3(i - 1, i, gtsam.Pose3(step), gtsam.noiseModel.Diagonal.Sigmas(sigmas)))
        for place, query, edge in loops:
            robust = gtsam.noiseModel.Robust.Create(kernel, gtsam.noiseModel.Gaussian.Information(edge.information[TO_GTSAM]))
            graph.add(gtsam.BetweenFactorPose3(place, query, gtsam.Pose3(edge.T_place_query), robust))
        values = gtsam.LevenbergMarquardtOptimizer(graph, values).optimize()
    return np.array([values.atPose3(i).matrix() for i in range(len(guesses))])


def fitted(path, truth, flat):
    """Returns the path aligned with the ground truth, and its absolute trajectory error (RMSE) [m]. flat: planar error."""
    path, truth = (trajectory.PosePath3D(poses_se3=list(each)) for each in (path, truth))
    if flat:
        path.project(trajectory.Plane.XY)
        truth.project(trajectory.Plane.XY)
    path.align(truth)
    ape = metrics.APE(metrics.PoseRelation.translation_part)
    ape.process_data((truth, path))
    return path.positions_xyz[:, :2], ape.get_statistic(metrics.StatisticsType.rmse)


def draw(file, paths, loops, title):
    figure = Figure(figsize=(8, 8), layout='constrained')
    axes = figure.subplots()
    for (label, path), color, style, width in zip(paths.items(), ['tab:blue', 'tab:orange', GRAY], ['-', '-', ':'], [5, 2.5, 1]):
        axes.plot(*path.T, style, color=color, label=label, linewidth=width)
    for ends, label in zip(loops, ['loops'] + [None] * len(loops)):
        axes.plot(*paths['corrected'][ends].T, 'o-', color='tab:green', markersize=3, linewidth=1, label=label)
    axes.set(aspect='equal', adjustable='datalim', title=title, xlabel='x [m]', ylabel='y [m]')
    figure.legend(loc='outside lower center', ncols=5)
    figure.savefig(file, transparent=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('data')
    parser.add_argument('--sequence', default='', help='sequence of a data set with several, topic of a bag')
    parser.add_argument('--simulate', type=float, metavar='METERS', help='simulate a drive of this length in the folder first')
    parser.add_argument('--sensor', help='sensor of the ring model (default: detected from the first scan)')
    parser.add_argument('--max-range', type=float, default=100, help='maximum range of odometry [m] (default %(default)s)')
    parser.add_argument('--keyframe', type=float, default=1, help='distance of keyframes [m] (default %(default)s)')
    parser.add_argument('--no-deskew', action='store_true', help='do not remove the motion distortion of scans with times of points')
    parser.add_argument('--local-map', type=float, default=0, metavar='METERS', help='describe the accumulated points of the last METERS')
    parser.add_argument('--flat', action='store_true', help='print the planar error')
    parser.add_argument('-o', '--output', required=True, type=Path, help='output folder')
    o = parser.parse_args()
    o.output.mkdir(parents=True, exist_ok=True)
    (o.output / 'trajectory.tum').touch()  # fails now if it is not writable
    if o.simulate is not None:
        program.run('simulate', '-o', o.data, '--length', o.simulate, '--every', 2, '--route', 'both')
    recording = recordings.open_recording(o.data, sequence=o.sequence)
    odometry, loops, node_of, node_of_frame = Odometry(o.max_range, not o.no_deskew), [], {}, {}
    ended, excluded, start = None, 0, time.perf_counter()
    moving = odometry.keyframes(with_progress(recording), o.keyframe)
    detector = LoopDetector(open_map(None, o.sensor, local_map=o.local_map), exclusion='meters=40')
    try:
        for visit in recognize(moving, detector):
            found, node = visit.found, len(odometry.chosen) - 1
            node_of[found.index] = node_of_frame[visit.scan.frame] = node
            excluded += found.rejection == 'odometry' and found.registered is not None  # others are far away
            if found.accepted and found.loop and found.registered:
                loops.append((node_of[found.loop.index], node, found.registered))
            if found.questioned:
                questioned = {node_of_frame[frame] for frame in found.questioned}
                print(f'{visit.scan.source}: drops {len(questioned)} earlier loops, which others contradict', file=sys.stderr)
                loops = [loop for loop in loops if loop[1] not in questioned]
    except (KeyboardInterrupt, errors.InputError) as error:  # an unreadable scan, or a truncated recording
        if not odometry.chosen:
            raise
        ended = error
    scans, path, chosen = [scan for scan, _ in odometry.moved], np.array([pose for _, pose in odometry.moved]), odometry.chosen
    moved = optimized(path[chosen], loops) @ np.linalg.inv(path[chosen])  # every scan moves with its last keyframe
    corrected = moved[np.searchsorted(chosen, np.arange(len(path)), side='right') - 1] @ path
    fit = sum(float(np.linalg.norm((np.linalg.inv(corrected[chosen[place]]) @ corrected[chosen[query]] - edge.T_place_query)[:3, 3])) < 1
              for place, query, edge in loops)
    times = np.array([scan.frame if scan.time is None else scan.time for scan in scans], np.float64)
    write_tum_trajectory_file(o.output / 'trajectory.tum', trajectory.PoseTrajectory3D(poses_se3=list(corrected), timestamps=times))
    paths, accuracy = {'odometry': path[:, :2, 3], 'corrected': corrected[:, :2, 3]}, 'unknown (no poses)'
    truth = np.array([scan.pose for scan in scans if scan.pose is not None])
    if len(truth) == len(path) and len(chosen) > 2:
        if abs(truth[0, 2, 2]) < abs(truth[0, 1, 2]):  # KITTI's world
            truth = poses.AXES_OF_CAMERA.T @ truth
        (before, odometry_error), (after, corrected_error) = (fitted(each, truth, o.flat) for each in (path, corrected))
        paths = {'odometry': before, 'corrected': after, 'truth': truth[:, :2, 3]}
        accuracy = f'odometry {odometry_error:.2f} m, corrected {corrected_error:.2f} m'
    print(f'{len(path)} scans, {len(chosen)} keyframes, {len(loops)} loops, {fit} with a residual below 1 m; '
          f'{time.perf_counter() - start:.1f} s in total, {odometry.seconds:.1f} s for odometry\nabsolute trajectory error: {accuracy}')
    draw(o.output / 'trajectory.png', paths, [[chosen[a], chosen[b]] for a, b, _ in loops],
         f'{"/".join(Path(o.data).parts[-2:])}, top-down: {len(loops)} loops, {fit} with a residual below 1 m\nabsolute trajectory error: {accuracy}')
    if ended:
        raise type(ended)(f'{str(ended) or "interrupted"}; {o.output} has the trajectory so far')
    if excluded + len(loops) - fit > max(fit, 5):
        print(f'slam: the odometry has diverged: {fit} loops agree with it, {len(loops) - fit} have a larger residual, and {excluded} more '
              'were rejected because it excludes them', file=sys.stderr)
        return 5
    return 0


if __name__ == '__main__':
    try:
        sys.exit(main())
    except (errors.Error, geometry.GeometryException, OSError, KeyboardInterrupt) as error:
        print(f'slam: {str(error) or "interrupted"}', file=sys.stderr)
        sys.exit(130 if isinstance(error, KeyboardInterrupt) else getattr(error, 'code', 1))
