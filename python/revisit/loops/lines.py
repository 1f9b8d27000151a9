"""Output lines of a scan: the columns and fields of `revisit loops`, docs/FORMATS.md."""

import csv
import json
import math

from revisit.poses import quaternion

COLUMNS = ('frame time match_drive match_frame match_time similarity kth_similarity score probability yaw_deg accepted registered '
           'x y z qx qy qz qw inlier_ratio mean_squared_distance here_x here_y here_z match_x match_y match_z drive rejection file').split()
DIGITS = {'yaw_deg': 2, 'here_x': 3, 'here_y': 3, 'here_z': 3, 'match_x': 3, 'match_y': 3, 'match_z': 3}
POSITIONS = {'position': 'here', 'match_position': 'match'}


def position_of(pose):
    return dict(zip('xyz', map(float, pose[:3, 3])))


def line_of(visit, drive) -> dict:
    scan, loop, registered = visit.scan, visit.loop, visit.registered
    line = {'frame': scan.frame, 'time': scan.time}
    if loop is not None:
        line |= {'match_drive': loop.drive, 'match_frame': loop.frame, 'match_time': loop.time, 'similarity': loop.similarity,
                 'kth_similarity': loop.kth_similarity, 'score': loop.score, 'probability': loop.probability,
                 'yaw_deg': None if loop.relative_yaw is None else math.degrees(loop.relative_yaw), 'accepted': visit.accepted}
    if registered is not None:
        T = registered.T_place_query
        line['registered'] = {
            'accepted': registered.accepted, **position_of(T), **dict(zip(('qx', 'qy', 'qz', 'qw'), map(float, quaternion(T[:3, :3])))),
            'inlier_ratio': registered.inlier_ratio, 'mean_squared_distance': registered.mean_squared_distance}
    if scan.pose is not None:
        line['position'] = position_of(scan.pose)
    if loop is not None and loop.pose is not None:
        line['match_position'] = position_of(loop.pose)
    line |= {'drive': drive or None, 'rejection': visit.found.rejection_reason or None, 'file': scan.source}
    return {name: value for name, value in line.items() if value is not None}


def json_text(line) -> str:
    """Returns the line in protobuf's JSON, where NaN is a string."""
    return json.dumps({name: repr_of(value) for name, value in line.items()}, separators=(',', ':'))


def repr_of(value):
    if isinstance(value, str):  # JSON must be UTF-8; names may have other bytes
        return value.encode('utf-8', 'surrogateescape').decode('utf-8', 'replace')
    if isinstance(value, float) and not math.isfinite(value):
        return 'NaN' if math.isnan(value) else 'Infinity' if value > 0 else '-Infinity'
    return value


def printable(text) -> str:
    """Escapes control characters, because file names are untrusted."""
    return ''.join(c if c.isprintable() or c == '\n' or '\ud800' <= c <= '\udfff' else ascii(c)[1:-1] for c in text)


def cell(name, value) -> str:
    if value is None or value != value:
        return ''
    if isinstance(value, bool):
        return str(int(value))
    return f'{value:.{DIGITS.get(name, 6)}f}' if isinstance(value, float) else str(value)


def cells_of(line) -> list[str]:
    registered = line.get('registered', {})
    flat = line | registered | {'accepted': line.get('accepted'), 'registered': registered.get('accepted')}
    for name, prefix in POSITIONS.items():
        flat |= {f'{prefix}_{axis}': value for axis, value in line.get(name, {}).items()}
    return [cell(name, flat.get(name)) for name in COLUMNS]


def writer(out, form):
    """Returns a function that writes and flushes a line, so that a killed run leaves its results. form: 'csv' or 'jsonl'."""
    rows = csv.writer(out, lineterminator='\n')
    if form == 'csv':
        rows.writerow(COLUMNS)
        out.flush()

    def write(line):
        if form == 'csv':
            rows.writerow(cells_of(line))
        else:
            out.write(json_text(line) + '\n')
        out.flush()
    return write
