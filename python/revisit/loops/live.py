"""Live view in Rerun: points of the scan, path, loops."""

from revisit.recordings.recording import package

MAX_POINTS = 20000
PART = 256
"""Elements per entity of a growing list, because an entity is logged again whenever it grows."""


def grower(log, name, make):
    elements = []

    def add(element):
        elements.append(element)
        part = (len(elements) - 1) // PART
        log(f'{name}/{part}', make(elements[part * PART:]))
    return add


def viewer(file=None):
    """Returns a function that shows a Visit. file: recording to write (.rrd); None: opens a window."""
    rr = package('rerun', 'rerun-sdk', 'the live view')
    rr.init('revisit-loops', spawn=file is None)
    if file is not None:
        rr.save(file)
    rr.log('scan', rr.ViewCoordinates.FLU, static=True)
    rr.log('map', rr.ViewCoordinates.RDF, static=True)
    green = [0, 158, 115]
    path = grower(rr.log, 'map/path', lambda positions: rr.Points3D(positions, colors=[160, 160, 160]))
    loops = grower(rr.log, 'map/loops', lambda pairs: rr.LineStrips3D(pairs, colors=green))
    frames = grower(rr.log, 'frames', lambda pairs: rr.Points2D(pairs, colors=green))

    def show(visit):
        scan, loop = visit.scan, visit.loop
        rr.set_time('frame', sequence=scan.frame)
        if visit.points is not None:
            rr.log('scan', rr.Points3D(visit.points[:: max(1, len(visit.points) // MAX_POINTS), :3]))
        if loop is not None:
            rr.log('score', rr.Scalars(loop.score))
        if scan.pose is not None:
            path(scan.pose[:3, 3])
        if visit.accepted:
            frames([scan.frame, loop.frame])
            if scan.pose is not None and loop.pose is not None:
                loops([scan.pose[:3, 3], loop.pose[:3, 3]])
    return show
