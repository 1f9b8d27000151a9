"""How two scans of a place lie to each other. By PCL where the build has it, else (every wheel) by the package small_gicp."""

import functools
import weakref

import numpy as np

from revisit._core import registration as _core
from revisit._core.registration import PreparedScan, Registration, RegistrationOptions

if not _core.HAS_PCL:
    try:
        import small_gicp
    except ImportError as error:
        raise ImportError("revisit.registration needs the package small_gicp: pip install 'revisit[registration]' "
                          f'({error})') from error

__all__ = ['PreparedScan', 'Registration', 'RegistrationOptions', 'register_scans']

_clouds = weakref.WeakKeyDictionary()


def _cloud_of(scan):
    """small_gicp's points with covariances, and their search tree."""
    import small_gicp
    if scan not in _clouds:
        cloud = small_gicp.PointCloud(scan.points.astype(np.float64))
        tree = small_gicp.KdTree(cloud)
        small_gicp.estimate_covariances(cloud, tree, num_neighbors=20)  # of the GICP paper
        _clouds[scan] = cloud, tree
    return _clouds[scan]


def _by_small_gicp(query, place, max_distance, start):
    """T_place_query near `start`, float64 [4][4]; `start` where there is none."""
    import small_gicp
    (source, _), (target, tree) = _cloud_of(query), _cloud_of(place)
    pose = small_gicp.align(target, source, tree, start, max_correspondence_distance=max_distance, rotation_epsilon=1e-4,
                            translation_epsilon=1e-3).T_target_source
    return pose if np.isfinite(pose).all() else start


def register_scans(query: PreparedScan, place: PreparedScan, turn: float,
                   options: RegistrationOptions = RegistrationOptions()) -> Registration:
    """Registers a query with a place.

    turn: heading of the query less that of the place, counter-clockwise [rad], as Loop.turn.
    First the shift within `options.reach`, and the turn within 3 degrees, under which upright points meet best, seen from above;
    from there generalized ICP. Raises UsageError for invalid options or a turn that is not finite.
    """
    by = None if _core.HAS_PCL else functools.partial(_by_small_gicp, query, place, options.max_distance)
    return _core.register_scans(query, place, turn, options, by)
