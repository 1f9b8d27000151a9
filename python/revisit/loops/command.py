"""revisit-loops: online loop detection in a bag, packets, a data set or a folder of scans."""

import contextlib
import itertools
import os
import sys
import tempfile

import numpy as np

import revisit
from revisit import maps, poses, program, recognition
from revisit.errors import Error, InputError, UsageError
from revisit.loops import lines, live, show
from revisit.loops.options import parse
from revisit.loops.progress import with_progress
from revisit.loops.recognize import recognize
from revisit.recordings import open_recording
from revisit.report import write_report

OK, FAILED, SKIPPED, INTERRUPTED = 0, 1, 6, 130
LOCAL_MAP_SENSOR = 'hdl64'
"""Sensor whose model describes local maps of all sensors."""
SCANS_THAT_SHOW_THE_SENSOR, SCANS_TRIED = 3, 20


def say(o, message):
    if not o.quiet:
        over = '\r\033[K' if sys.stderr.isatty() else ''  # clears the progress line
        print(f'{over}revisit-loops: {lines.printable(message)}', file=sys.stderr)


def with_poses(o, recording):
    if not o.poses:
        return recording.scans()
    trajectory = poses.read_trajectory(o.poses, o.pose_format)
    extrinsic = None if o.calib is None else poses.read_extrinsic(o.calib)
    frames, times = recording.times()
    kept = [i for i, frame in enumerate(frames) if frame % o.every == 0]
    if not kept:
        return recording.scans()
    frames, times = [frames[i] for i in kept], [times[i] for i in kept]
    given = poses.in_kitti_world(poses.matched(trajectory, frames, times, o.max_gap), o.pose_frame, extrinsic)
    if trajectory.times is None and o.every == 1 and len(trajectory.poses) != frames[-1] + 1:
        say(o, f'warning: {trajectory.file}: expected {frames[-1] + 1} poses (the last scan is frame {frames[-1]}), '
               f'found {len(trajectory.poses)}; if lines are missing, later scans have wrong poses')
    by_frame = dict(zip(frames, given))
    return (scan._replace(pose=by_frame.get(scan.frame)) for scan in recording.scans())


def first_of(scans):
    """Returns the first scans, until enough have points to detect the sensor."""
    first, with_points = [], 0
    for scan in scans:
        first.append(scan)
        with contextlib.suppress(InputError):
            with_points += len(returns(scan.points())) > 0
        if with_points == SCANS_THAT_SHOW_THE_SENSOR or len(first) == SCANS_TRIED:
            break
    return first


def sensor_of(o, first):
    clouds = []
    for scan in first:
        with contextlib.suppress(InputError):
            points = mounted(o, returns(scan.points()))
            clouds += [points] if len(points) else []
    if defect := recognition.scan_frame_error(clouds):
        say(o, f'warning: {defect}')
    if o.ring or o.sensor != 'auto':
        return o.sensor
    if o.local_map:
        of_map = recognition.shipped_ring_sensor(maps.feature_key_of(o.map)) if o.map else ''
        say(o, f'sensor: {of_map} (of the map)' if of_map else f'sensor: {LOCAL_MAP_SENSOR} (of local maps)')
        return of_map or LOCAL_MAP_SENSOR
    if not clouds:
        raise InputError(f'{o.data}: none of the first {len(first)} scans can be read to choose a model; give --sensor')
    sensor, reason = recognition.choose_ring_model(clouds, maps.feature_key_of(o.map) if o.map else '')
    say(o, f'sensor: {sensor} ({reason})')
    return sensor


def returns(points):
    points = np.ascontiguousarray(points[:, :3])
    return points[np.isfinite(points).all(1) & (points != 0).any(1)]


def mounted(o, points):
    if not o.mount:
        return points
    T = recognition.parse_mount(o.mount)
    return (points @ T[:3, :3].T + T[:3, 3]).astype(np.float32)


def open_output(name, stack):
    if name is None:
        if sys.stdout is None:
            raise Error('standard output is closed; give -o FILE')
        return sys.stdout
    try:  # surrogateescape writes names that are not UTF-8 unchanged
        return stack.enter_context(open(name, 'w', encoding='utf-8', errors='surrogateescape'))
    except OSError as error:
        raise Error(f'{name}: cannot be written: {error.strerror}') from None


def finish(o, seen, jsonl):
    """Must be called for an interrupted run, too."""
    if o.plot and seen:
        show.plot(seen, o.plot)
    if o.report:
        jsonl.flush()
        write_report(jsonl.name, o.report)


def work(o):
    if o.report:
        program.path()
    if o.plot:
        show.need_matplotlib()
    view = None if o.rerun is None else live.viewer(o.rerun or None)
    recording = open_recording(o.data, format=o.reader, topic=o.topic, sequence=o.sequence, meta=o.meta)
    for warning in recording.warnings:
        say(o, warning)
    scans = (scan for scan in with_poses(o, recording) if scan.frame % o.every == 0)
    first = first_of(scans)
    if not first:
        raise InputError(f'{o.data}: there are no scans')
    if o.poses_out and first[0].pose is None:
        raise UsageError('--poses-out: the scans have no poses; give --poses')
    if o.local_map and first[0].pose is None:
        raise UsageError(f'--local-map: {first[0].source} has no pose; give --poses')
    target = {} if o.target_precision is None else {'target_precision': o.target_precision}
    recognizer = revisit.open_map(
        o.map, sensor_of(o, first), model=recognition.read_ring_model(o.ring) if o.ring else None, threshold=o.threshold,
        **target, warmup=o.warmup, threads=o.threads, mount=o.mount,
        local_map=o.local_map)
    drive = recording.name if o.drive is None else o.drive
    detector = revisit.LoopDetector(recognizer, drive=drive, exclusion=o.exclusion, keyframes=o.keyframes, verify=o.verify,
                                    threshold=o.threshold, **target, keep_clouds=not o.no_clouds, local_map=o.local_map)
    for warning in recognizer.warnings:
        say(o, f'warning: {warning}')
    if detector.verifies and o.threshold is None and recognizer.is_calibrated and not recognizer.is_calibrated_for_registered:
        say(o, "warning: the map's threshold or calibration is for loops without registration and is ignored; run "
               '`revisit loops --calibrate` again, or give --no-verify')
    if detector.threshold is None and detector.highest_precision is not None:
        asked = ' (the default)' if o.target_precision is None else f' {o.target_precision:g}'
        raise UsageError(f'--target-precision{asked}: no threshold reaches it; the best precision of the calibration is '
                         f'{detector.highest_precision:.5f}; give a lower one, or --threshold')
    if detector.threshold is None and o.target_precision is not None:
        raise UsageError('--target-precision: this feature is not calibrated; give --threshold')
    every_line = o.all or detector.threshold is None
    if every_line and not o.all:
        say(o, 'no threshold: every scan is printed; give --threshold, or a map that '
               '`revisit loops --calibrate` has calibrated')

    def as_given(pose):
        return None if pose is None else poses.in_frame(pose, o.pose_frame or 'camera')

    count = recording.count and -(-recording.count // o.every)
    summary, seen, n_poses, n_tum, not_in_graph = maps.LoopSummary(o.exclusion, detector.threshold), [], 0, 0, 0
    with contextlib.ExitStack() as stack:
        write = lines.writer(open_output(o.output, stack), o.format)
        trajectory = open_output(o.poses_out, stack) if o.poses_out else None
        registered = open_output(o.tum, stack) if o.tum else None
        graph = maps.PoseGraphWriter(o.g2o) if o.g2o else None
        jsonl = stack.enter_context(tempfile.NamedTemporaryFile('w', suffix='.jsonl')) if o.report else None
        write_all = lines.writer(jsonl, 'jsonl') if jsonl else None
        try:
            shown = with_progress(itertools.chain(first, scans), count, False if o.quiet else None)
            for visit in recognize(shown, detector, not o.no_deskew):
                summary.add(visit.found)
                if view:
                    view(visit)
                if visit.error:
                    say(o, f'{visit.error}; scan skipped')
                    continue
                n_poses += visit.scan.pose is not None
                line = lines.line_of(visit, detector.drive)
                fits = visit.registered is not None and visit.accepted
                time = visit.scan.frame if visit.scan.time is None else visit.scan.time
                not_in_graph += fits and visit.index is None
                if graph and visit.index is not None:
                    graph.vertex(visit.index, as_given(visit.scan.pose))
                    if fits:
                        graph.known_vertex(visit.loop.index, as_given(visit.loop.pose))
                        graph.edge(visit.loop.index, visit.index, visit.registered)
                if registered and fits and visit.loop.pose is not None:
                    n_tum += 1
                    print(poses.tum_line(time, as_given(visit.loop.pose @ visit.registered.T_place_query)), file=registered, flush=True)
                if visit.accepted or every_line:
                    write(line)
                if write_all:
                    write_all(line)
                if o.plot:
                    seen.append(line)
                if trajectory and visit.accepted and visit.scan.pose is not None:
                    pose = poses.in_frame(visit.scan.pose, o.pose_frame or 'lidar')
                    print(poses.tum_line(time, pose), file=trajectory, flush=True)
        finally:
            finish(o, seen, jsonl)
    if detector.drive != drive:
        say(o, f"the map has another recording '{drive}'; this one is stored as '{detector.drive}'")
    say(o, f'{summary}, {len(recognizer)} map entries')
    if registered and not n_tum:
        say(o, f'warning: {o.tum}: the file is empty, because no loop was registered to a map entry with a pose')
    if graph and not_in_graph:
        say(o, f'warning: {o.g2o}: {not_in_graph} loops are missing, because their scans are not stored')
    if graph and not n_poses:
        say(o, f'warning: {o.g2o}: no odometry edges, and all vertices at the origin, because the scans have no poses')
    return SKIPPED if summary.skipped else OK


def failed(why, code) -> int:
    print(f'revisit-loops: {lines.printable(str(why))}', file=sys.stderr)
    return code


def main(arguments=None) -> int:
    """The command. Returns the exit code; argparse exits itself for --help and unknown options."""
    sys.stderr = sys.stderr or open(os.devnull, 'w')  # if it is closed, print() would write to standard output
    try:
        if sys.stdout is not None and hasattr(sys.stdout, 'reconfigure'):
            sys.stdout.reconfigure(errors='surrogateescape')  # prints names that are not UTF-8 unchanged
        code = work(parse(arguments))
        if sys.stdout is not None:
            sys.stdout.flush()
        return code
    except KeyboardInterrupt:
        return failed('interrupted; results so far are kept', INTERRUPTED)
    except BrokenPipeError:  # the reader has exited, e.g. `head`
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return FAILED
    except (Error, OSError) as error:
        return failed(error, getattr(error, 'code', FAILED))
    except MemoryError:
        return failed('out of memory', FAILED)
    except Exception as error:  # a bug here or in a package: reported in one line
        return failed(f'{type(error).__name__}: {" ".join(str(error).split())}', FAILED)
