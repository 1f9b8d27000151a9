"""Pairs of scans of one place, of a simulated drive whose poses are exact, registered."""

import numpy as np

from revisit import registration
from revisit.recordings import open_recording

DRIVEN_BETWEEN = 50
"""From the first visit to the second, at least [m]."""


def rotation_vector(R):
    """[rad], of a rotation [3][3] by less than half a turn."""
    skew = np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]]) / 2
    sine = np.linalg.norm(skew)
    return skew * (np.arctan2(sine, (np.trace(R) - 1) / 2) / sine if sine > 1e-12 else 1)


def error_of(found, truth):
    """(t, w): truth = found * (t, exp(w)), [m] and [rad]."""
    error = np.linalg.inv(found) @ truth
    return np.r_[error[:3, 3], rotation_vector(error[:3, :3])]


def pairs_of(drive, count, apart=5, seed=1):
    """(query, place) of the second visit of a place and of one before, up to `apart` metres away; chosen at random."""
    scans = list(open_recording(drive).scans())
    at = np.array([scan.pose[:3, 3] for scan in scans])
    driven = np.r_[0, np.cumsum(np.linalg.norm(np.diff(at, axis=0), axis=1))]
    pairs = [(i, k) for i in range(len(scans)) for k in range(i)
             if driven[i] - driven[k] > DRIVEN_BETWEEN and np.linalg.norm(at[i] - at[k]) < apart]
    chosen = np.random.default_rng(seed).permutation(len(pairs))[:count]
    return [(scans[pairs[i][0]], scans[pairs[i][1]]) for i in chosen]


def registered(pairs, register=registration.register_scans, seed=1):
    """Yields truth and Registration of each pair, from a turn that is a degree off (standard deviation)."""
    prepared = {}
    rng = np.random.default_rng(seed)
    for pair in pairs:
        for scan in pair:
            if scan.frame not in prepared:
                prepared[scan.frame] = registration.PreparedScan(scan.points())
        query, place = pair
        truth = np.linalg.inv(place.pose) @ query.pose
        turn = np.arctan2(truth[1, 0], truth[0, 0]) + rng.normal(0, np.radians(1))
        yield truth, register(prepared[query.frame], prepared[place.frame], turn)


def normalised_squares(registrations):
    """e^T I e of each accepted one of (truth, Registration): of 6 degrees of freedom, 6 on average."""
    found = []
    for truth, result in registrations:
        if result.accepted:
            error = error_of(result.T_place_query, truth)
            found.append(error @ result.information @ error)
    return np.array(found)
