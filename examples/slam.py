#!/usr/bin/env python3
"""A corrected trajectory from scans: odometry by KISS-ICP, loops by revisit, a robust pose graph by GTSAM.

  slam.py scans/ -o out                                    # .bin, .pcd or .ply files, KITTI's layout, data sets
  slam.py drive.bag --topic /points -o out                 # what revisit.recordings reads
  slam.py town --simulate 600 -o out                       # makes a drive there first

Writes out/trajectory.tum (T_world_lidar, z up, of every scan) and out/trajectory.png. Where the recording has poses, the
error of the trajectory is printed, before and after. pip install 'revisit[slam]'
"""

import argparse
import time
from pathlib import Path

import gtsam
import matplotlib
import numpy as np
from evo.core.metrics import APE, PoseRelation
from evo.core.trajectory import Plane, PosePath3D
from kiss_icp.config import KISSConfig
from kiss_icp.kiss_icp import KissICP
from revisit import errors, open_map, poses, recognition, registration, simulation
from revisit.loops import Exclusion, recognise
from revisit.recordings import open_recording

TO_GTSAM = [3, 4, 5, 0, 1, 2]  # its errors have the rotation first
DRIFT = np.radians([0.05, 0.05, 0.05, 1, 1, 1])  # of the odometry in a metre: rotation [rad], translation 0.017 [m]


class Odometry:
    """Where KISS-ICP says that each scan was, and which of them are keyframes."""

    def __init__(self, max_range):
        self.kiss = KissICP(KISSConfig(data={'max_range': max_range, 'deskew': False}, mapping={'voxel_size': max_range / 100}))
        self.scans, self.path, self.chosen, self.seconds = [], [], [], 0

    def keyframes(self, scans, every):
        """Those of the scans that are `every` metres apart."""
        for scan in scans:
            points = scan.points()
            start = time.perf_counter()
            self.kiss.register_frame(points[:, :3].astype(np.float64), np.zeros(len(points)))
            self.seconds += time.perf_counter() - start
            self.scans.append(scan._replace(points=None))
            self.path.append(self.kiss.last_pose.copy())
            if not self.chosen or np.linalg.norm(self.path[-1][:3, 3] - self.path[self.chosen[-1]][:3, 3]) >= every:
                self.chosen.append(len(self.path) - 1)
                yield scan._replace(points=lambda points=points: points)


def optimised(guesses, loops):
    """The poses [n][4][4] that odometry and loops agree on best. loops: (place, query, Registration)."""
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    for i, pose in enumerate(guesses):
        values.insert(i, gtsam.Pose3(pose))
    graph.add(gtsam.PriorFactorPose3(0, gtsam.Pose3(guesses[0]), gtsam.noiseModel.Isotropic.Sigma(6, 1e-3)))
    for i in range(1, len(guesses)):
        step = np.linalg.inv(guesses[i - 1]) @ guesses[i]
        sigmas = DRIFT * max(1, np.linalg.norm(step[:3, 3])) ** 0.5
        graph.add(gtsam.BetweenFactorPose3(i - 1, i, gtsam.Pose3(step), gtsam.noiseModel.Diagonal.Sigmas(sigmas)))
    for place, query, found in loops:
        noise = gtsam.noiseModel.Gaussian.Information(found.information[np.ix_(TO_GTSAM, TO_GTSAM)])
        robust = gtsam.noiseModel.Robust.Create(gtsam.noiseModel.mEstimator.Cauchy.Create(3), noise)
        graph.add(gtsam.BetweenFactorPose3(place, query, gtsam.Pose3(found.T_place_query), robust))
    result = gtsam.LevenbergMarquardtOptimizer(graph, values).optimize()
    return np.array([result.atPose3(i).matrix() for i in range(len(guesses))])


def spread(path, chosen, corrected):
    """All poses, moved along with the keyframe before them."""
    before = np.searchsorted(chosen, np.arange(len(path)), side='right') - 1
    return np.array([corrected[k] @ np.linalg.inv(path[chosen[k]]) @ pose for k, pose in zip(before, path)])


def fitted(path, truth, flat):
    """The path laid onto the truth, and the root mean square of its distances [m]. flat: seen from above."""
    path, truth = PosePath3D(poses_se3=list(poses.AXES_OF_CAMERA @ path)), PosePath3D(poses_se3=list(truth))
    if flat:
        path.project(Plane.XZ), truth.project(Plane.XZ)
    path.align(truth)
    ape = APE(PoseRelation.translation_part)
    ape.process_data((truth, path))
    return path.positions_xyz[:, [0, 2]], float(np.sqrt(np.mean(ape.error ** 2)))


def draw(file, paths, loops):
    matplotlib.use('Agg')
    from matplotlib import pyplot
    figure, axes = pyplot.subplots(figsize=(8, 8), layout='constrained')
    for (label, path), style in zip(paths.items(), ['tab:blue', 'tab:orange', 'k:']):
        axes.plot(*path.T, style, label=label, linewidth=1.5)
    for ends in loops:
        axes.plot(*paths['corrected'][ends].T, '.-', color='tab:green', markersize=3)
    axes.set_aspect('equal', adjustable='datalim')
    axes.set(xlabel='[m]', ylabel='[m]', title=f'{len(loops)} loops')
    axes.legend()
    figure.savefig(file)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('data')
    parser.add_argument('--topic', help='of a bag that has several')
    parser.add_argument('--sequence', default='', help='of a data set that has several')
    parser.add_argument('--simulate', type=float, metavar='METRES', help='make a drive of this length in the folder first')
    parser.add_argument('--sensor', help='found from the first scan unless given')
    parser.add_argument('--max-range', type=float, default=100, help='of odometry [m] (default %(default)s)')
    parser.add_argument('--keyframe', type=float, default=1, help='metres from one place to the next (default %(default)s)')
    parser.add_argument('--flat', action='store_true', help='compare with the truth as seen from above')
    parser.add_argument('-o', '--output', required=True, help='a folder')
    o = parser.parse_args()
    if o.simulate:
        simulation.simulate(o.data, length=o.simulate, every=2, route='both')
    recording = open_recording(o.data, topic=o.topic, sequence=o.sequence)
    sensor = o.sensor or recognition.find_sensor([next(recording.scans()).points()[:, :3].copy()]).name
    odometry, loops, node_of = Odometry(o.max_range), [], {}
    start = time.perf_counter()
    moving = odometry.keyframes(recording.scans(), o.keyframe)
    for visit in recognise(moving, open_map(None, sensor), Exclusion('frames', 50), verify=True):
        node_of[visit.position] = len(odometry.chosen) - 1
        if visit.registered and visit.accepted:
            loops.append((node_of[visit.loop.position], len(odometry.chosen) - 1, visit.registered))
    recognised = time.perf_counter()
    path, chosen, scans = np.array(odometry.path), odometry.chosen, odometry.scans
    corrected = spread(path, chosen, optimised(path[chosen], loops))
    seconds = {'odometry': odometry.seconds, 'reading and loops': recognised - start - odometry.seconds,
               'optimisation': time.perf_counter() - recognised}

    folder = Path(o.output)
    folder.mkdir(parents=True, exist_ok=True)
    times = [scan.frame if scan.time is None else scan.time for scan in scans]
    (folder / 'trajectory.tum').write_text('\n'.join(map(poses.tum_line, times, corrected)) + '\n')
    paths = {'odometry': path[:, :2, 3], 'corrected': corrected[:, :2, 3]}
    print(f'{len(path)} scans, {len(chosen)} keyframes, {len(loops)} loops; ' + ', '.join(
        f'{what} {1e3 * each / len(path):.1f}' for what, each in seconds.items()) + ' ms a scan')
    if all(scan.pose is not None for scan in scans):
        truth = np.array([scan.pose for scan in scans])
        for name, poses_of in (('odometry', path), ('corrected', corrected)):
            paths[name], error = fitted(poses_of, truth, o.flat)
            print(f'absolute trajectory error, {name}: {error:.2f} m')
        paths['truth'] = truth[:, [0, 2], 3]
    draw(folder / 'trajectory.png', paths, [[chosen[a], chosen[b]] for a, b, _ in loops])


if __name__ == '__main__':
    try:
        main()
    except errors.Error as error:
        raise SystemExit(f'slam: {error}')
