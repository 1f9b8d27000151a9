"""Reader of recorded network packets of sensors: Ouster by ouster-sdk, Velodyne by velodyne-decoder."""

import numpy as np

from revisit.errors import Error, InputError
from revisit.recordings.recording import RecordedTimes, Recording, Scan, package


def metadata_of(path):
    """Returns the Ouster metadata (.json) in the folder of a .pcap: the file with the longest common prefix."""
    def alike(file):
        return next((i for i, (a, b) in enumerate(zip(file.name, path.name)) if a != b), len(path.stem))
    files = [file for file in path.parent.glob('*.json') if file.is_file() and b'beam_altitude_angles' in file.read_bytes()]
    return max(files, key=alike, default=None)


def detects_ouster(path):
    return path.suffix == '.osf' or (path.suffix == '.pcap' and metadata_of(path) is not None)


def detects_velodyne(path):
    return path.suffix == '.pcap'


def from_iterator(path, frames) -> Recording:
    """frames(): yields (time, points, times of points); called again for every pass."""
    def scans():
        try:
            for frame, (time, *read) in enumerate(frames()):
                yield Scan(frame, time, None, lambda read=read: read, f'{path}, frame {frame}')
        except Error:
            raise
        except Exception as error:  # the packages raise many types for corrupted files
            raise InputError(f'{path}: cannot be read as packets: {str(error) or type(error).__name__}') from error

    if next(scans(), None) is None:
        raise InputError(f'{path}: the packets contain no scans')
    return Recording(path.stem, None, scans)


def open_ouster(path) -> Recording:
    sdk = package('ouster.sdk', 'ouster-sdk', f'{path}: reading Ouster packets')
    core = package('ouster.sdk.core', 'ouster-sdk', f'{path}: reading Ouster packets')
    meta = metadata_of(path) if path.suffix == '.pcap' else None

    def frames():
        tables = {}
        for item in sdk.open_source(str(path), **({'meta': [str(meta)]} if meta else {})):
            for frame in item:
                if frame is None:
                    continue
                info = frame.sensor_info
                if info.sn not in tables:
                    tables[info.sn] = core.XYZLut(info)
                seen = frame.field(core.ChanField.RANGE) != 0
                stamps = np.asarray(frame.timestamp)[np.asarray(frame.status) & 1 == 1]
                since = (np.asarray(frame.timestamp).astype(np.int64) - int(stamps[0]) if len(stamps) else np.zeros(frame.w))[None]
                yield (stamps[0] * 1e-9 if len(stamps) else None, tables[info.sn](frame)[seen].astype(np.float32),
                       RecordedTimes('timestamp', np.broadcast_to(since, seen.shape)[seen]))
                break  # only the first sensor

    return from_iterator(path, frames)


def open_velodyne(path) -> Recording:
    decoder = package('velodyne_decoder', 'velodyne-decoder',
                      f'{path}: reading Velodyne packets (Ouster packets need a .json file of metadata in the same folder)')

    def frames():
        for stamp, points in decoder.read_pcap(str(path)):
            yield float(getattr(stamp, 'host', stamp)), points, RecordedTimes('time', points[:, decoder.PointField.time])

    return from_iterator(path, frames)
