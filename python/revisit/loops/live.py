"""A live view in Rerun: the points of the scan, the path driven, the loops."""

from revisit.recordings.recording import package

MOST_POINTS = 20000
"""Of a scan that are shown."""


def viewer(file=None):
    """A function that shows a Visit. file: written for later (.rrd); None: a window is opened."""
    rr = package('rerun', 'rerun-sdk', 'the live view')
    rr.init('revisit-loops', spawn=file is None)
    if file is not None:
        rr.save(file)
    path, loops, pairs = [], [], []

    def show(visit):
        scan, loop = visit.scan, visit.loop
        rr.set_time('frame', sequence=scan.frame)
        if visit.points is not None:
            rr.log('scan', rr.Points3D(visit.points[:: max(1, len(visit.points) // MOST_POINTS), :3]))
        if loop is not None:
            rr.log('score', rr.Scalars(loop.score))
        accepted = loop is not None and loop.accepted
        if scan.pose is not None:
            path.append(scan.pose[:3, 3])
            rr.log('map/path', rr.LineStrips3D([path], colors=[160, 160, 160]))
            if accepted and loop.pose is not None:
                loops.append([scan.pose[:3, 3], loop.pose[:3, 3]])
                rr.log('map/loops', rr.LineStrips3D(loops, colors=[0, 158, 115]))
        if accepted:
            pairs.append([scan.frame, loop.frame])
            rr.log('frames', rr.Points2D(pairs, colors=[0, 158, 115]))
    return show
