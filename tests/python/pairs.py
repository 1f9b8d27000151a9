"""Registered pairs of scans of one place, from simulated drives with exact poses."""

import numpy as np

from revisit import datasets, registration
from revisit.recordings import open_recording

DRIVEN_BETWEEN = 50
"""Minimum path length between two visits [m]."""
CHANGE = np.r_[0.0125, 0.007, 0.004, np.radians([0.11, 0.13, 0.075])]
"""Change of a car's motion between two scans, 0.1 s apart: standard deviations (t, w) of the poses of KITTI 01 to 10 [m, rad]."""

WITHOUT_HEIGHT = [0, 1, 3, 4, 5]
"""Degrees of freedom by which revisits of NCLT are judged, because heights of its ground truth differ between visits."""


def as_they_are(points, rng):
    """For scans of a real drive, in the place of distorted()."""
    return points


def rotation_vector(R):
    """Rotation vector [rad] of a rotation [3][3] by less than pi."""
    skew = np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]]) / 2
    sine = np.linalg.norm(skew)
    return skew * (np.arctan2(sine, (np.trace(R) - 1) / 2) / sine if sine > 1e-12 else 1)


def error_of(found, truth):
    """Returns (t, w) with truth = found * (t, exp(w)), in [m] and [rad]."""
    error = np.linalg.inv(found) @ truth
    return np.r_[error[:3, 3], rotation_vector(error[:3, :3])]


def distorted(points, rng):
    """Returns a scan [n][3+] that was deskewed by the preceding motion, as if that had differed like a car's."""
    change = rng.normal(0, CHANGE)
    angle = np.linalg.norm(change[3:])
    x, y, z = change[3:] / angle
    K = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    motion = np.eye(4)
    motion[:3, :3] += np.sin(angle) * K + (1 - np.cos(angle)) * K @ K
    motion[:3, 3] = change[:3]
    times = np.arctan2(points[:, 1], points[:, 0]) / (2 * np.pi) % 1 * 0.1
    return datasets.deskew(points, times.astype(np.float32), motion, 0.1)


def pairs_of(drive, count, apart=5, seed=1):
    """Returns random pairs (query, place) of a revisit and an earlier visit, up to `apart` meters away."""
    return revisits_of(list(open_recording(drive).scans()), count, apart, seed)


def revisits_of(scans, count, apart=5, seed=1):
    at = np.array([scan.pose[:3, 3] for scan in scans])
    driven = np.r_[0, np.cumsum(np.linalg.norm(np.diff(at, axis=0), axis=1))]
    pairs = [(i, k) for i in range(len(scans)) for k in range(i)
             if driven[i] - driven[k] > DRIVEN_BETWEEN and np.linalg.norm(at[i] - at[k]) < apart]
    chosen = np.random.default_rng(seed).permutation(len(pairs))[:count]
    return [(scans[pairs[i][0]], scans[pairs[i][1]]) for i in chosen]


def real_pairs(drive, poses, count):
    """Returns pairs of consecutive scans and of revisits of a drive, by its file of the LiDAR's poses in the format of KITTI."""
    poses = [np.vstack([pose.reshape(3, 4), [0, 0, 0, 1]]) for pose in np.loadtxt(poses)]
    scans = [scan._replace(pose=pose) for scan, pose in zip(open_recording(drive).scans(), poses)]
    first = np.random.default_rng(1).permutation(len(scans) - 1)[:count]
    return {'consecutive': [(scans[k + 1], scans[k]) for k in first], 'revisits': revisits_of(scans, count)}


def registered(pairs, register=registration.register_scans, seed=1, prepare=distorted):
    """Yields ground truth and Registration of pairs of distorted scans, with an initial yaw error of 1 degree (standard deviation)."""
    prepared = {}
    rng = np.random.default_rng(seed)
    for pair in pairs:
        for scan in pair:
            if scan.frame not in prepared:
                prepared[scan.frame] = registration.PreparedScan(prepare(scan.points(), rng))
        query, place = pair
        truth = np.linalg.inv(place.pose) @ query.pose
        turn = np.arctan2(truth[1, 0], truth[0, 0]) + rng.normal(0, np.radians(1))
        yield truth, register(prepared[query.frame], prepared[place.frame], turn)


def normalized_squares(registrations, dof=slice(6)):
    """Returns the NEES e^T I e of accepted pairs (truth, Registration) over some degrees of freedom: mean 6 of all, if consistent."""
    found = []
    for truth, result in registrations:
        if result.fits:
            error = error_of(result.T_place_query, truth)[dof]
            found.append(error @ np.linalg.solve(np.linalg.inv(result.information)[dof][:, dof], error))
    return np.array(found)
