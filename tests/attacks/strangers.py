"""Files of strangers: recordings, and what is converted."""

import functools
import io
import json
import os
import pickle
import re
import struct
import zipfile
import zlib

import numpy as np

from harness import Case, Fault, capture, damage, damaged
from nets import CONVOLVE

REVISIT = os.environ.get('REVISIT_PROGRAM', 'revisit')
T0 = 1560000000000000000


def some_points(seed, n=60):
    return np.random.default_rng(seed).uniform(-20, 20, (n, 3)).astype(np.float32)


def put(folder, name, content):
    file = folder / name
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_bytes(content if isinstance(content, bytes) else content.encode())
    return file


# Recordings: a function writes each kind into a folder and returns (path, options)

def columns(points, *more):
    return np.concatenate([points, *[np.full((len(points), 1), value, np.float32) for value in more]], 1).tobytes()


def kitti(folder):
    for i in range(2):
        put(folder, f'sequences/03/velodyne/{i:06}.bin', columns(some_points(i), 0.5))
    put(folder, 'sequences/03/times.txt', '0.0\n0.1\n')
    put(folder, 'sequences/03/calib.txt', 'P0: ' + '1 ' * 12 + '\nTr: 0 -1 0 0.1 0 0 -1 0.2 1 0 0 0.3\n')
    put(folder, 'poses/03.txt', '1 0 0 0 0 1 0 0 0 0 1 0\n' * 2)
    return folder, {'sequence': '03'}


def ply(folder):
    points = some_points(1)
    put(folder, 'ply/1.ply', f'ply\nformat binary_little_endian 1.0\nelement vertex {len(points)}\nproperty float x\nproperty float y\n'
        'property float z\nend_header\n'.encode() + points.tobytes())
    put(folder, 'ply/2.ply', 'ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\nproperty float z\n'
        'end_header\n1 2 3\n4 5 6\n')
    return folder / 'ply', {}


def pcd(folder):
    points = some_points(1)
    head = f'VERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH {len(points)}\nHEIGHT 1\nPOINTS {len(points)}\n'
    put(folder, 'pcd/1.pcd', f'{head}DATA binary\n'.encode() + points.tobytes())
    packed = bytes([31]) + b'x' * 32  # not LZF of anything
    put(folder, 'pcd/2.pcd', f'{head}DATA binary_compressed\n'.encode() + struct.pack('<II', len(packed), points.nbytes) + packed)
    put(folder, 'pcd/3.pcd', f'{head}DATA ascii\n' + '1 2 3\n' * len(points))
    return folder / 'pcd', {}


def npy(folder):
    np.save(folder / '1.npy', some_points(1))
    np.save(folder / '2.npy', np.asfortranarray(some_points(2).astype('>f8')))
    return folder, {}


def mulran(folder):
    for i in range(2):
        put(folder, f'Ouster/{T0 + i * 10**8}.bin', columns(some_points(i), 100))
    put(folder, 'global_pose.csv', ''.join(f'{T0 + i * 10**8},1,0,0,{i},0,1,0,4,0,0,1,20\n' for i in range(2)))
    return folder, {}


def helipr(folder):
    put(folder, f'LiDAR/Ouster/{T0}.bin', b''.join(struct.pack('<ffffIHHH', *point, 1.5, 7, 8, 9, 10) for point in some_points(1).tolist()))
    put(folder, 'LiDAR_GT/global_Ouster_gt.txt', f'{T0} 1 2 3 0 0 0.7071068 0.7071068\n')
    return folder, {}


def nclt(folder):
    day = folder / '2012-01-08'
    put(day, 'velodyne_sync/1326030975000000.bin', np.random.default_rng(1).integers(0, 65536, 200, np.uint16).tobytes())
    put(folder, 'ground_truth/groundtruth_2012-01-08.csv', '1326030975000000,1,2,3,0,0,1.5\n')
    return day, {}


def kitti_360(folder):
    drive = '2013_05_28_drive_0003_sync'
    put(folder, f'data_3d_raw/{drive}/velodyne_points/data/0000000001.bin', columns(some_points(1), 0.5))
    put(folder, f'data_3d_raw/{drive}/velodyne_points/timestamps.txt', '2013-05-28 08:46:02.100000000\n' * 2)
    put(folder, f'data_poses/{drive}/poses.txt', '1 1 0 0 5 0 1 0 6 0 0 1 7\n')
    put(folder, 'calibration/calib_cam_to_pose.txt', 'image_00: 0 0 1 1 1 0 0 2 0 1 0 3\n')
    put(folder, 'calibration/calib_cam_to_velo.txt', '0 0 1 0.5 -1 0 0 0.25 0 -1 0 0\n')
    return folder, {}


def nuscenes(folder, filename=None, **change):
    name = 'samples/LIDAR_TOP/n015__LIDAR_TOP__1532402927647951.pcd.bin'
    put(folder, name, columns(some_points(1), 12, 3))
    tables = {
        'scene': [{'token': 's', 'name': 'scene-0061'}], 'sample': [{'token': 'a', 'scene_token': 's'}],
        'calibrated_sensor': [{'token': 'c', 'translation': [1, 0, 1.8], 'rotation': [0.7071068, 0, 0, -0.7071068]}],
        'ego_pose': [{'token': 'e', 'translation': [10, 20, 0], 'rotation': [1, 0, 0, 0]}],
        'sample_data': [{'token': 'd', 'sample_token': 'a', 'ego_pose_token': 'e', 'calibrated_sensor_token': 'c',
                         'timestamp': 1532402927647951, 'filename': filename or name}]}
    for table, rows in (tables | change).items():
        put(folder, f'v1.0-mini/{table}.json', rows if isinstance(rows, (str, bytes)) else json.dumps(rows))
    return folder, {}


def bag(kind, folder):
    from bags import HAVE_ROSBAGS, packed, write_bag
    if not HAVE_ROSBAGS:
        raise ImportError('without the package rosbags')
    return write_bag(folder, kind, {'/points': [packed(some_points(seed)) for seed in range(2)]}), {}


def pcap(folder):
    from test_recordings import Packets, have
    if not have('velodyne_decoder'):
        raise ImportError('without the package velodyne-decoder')
    writer = Packets()
    writer.folder = folder
    return writer.write_vlp16(), {}


KINDS = {'kitti': kitti, 'ply': ply, 'pcd': pcd, 'npy': npy, 'mulran': mulran, 'helipr': helipr, 'nclt': nclt, 'kitti_360': kitti_360,
         'nuscenes': nuscenes, 'pcap': pcap} | {kind: functools.partial(bag, kind) for kind in ('ros1', 'sqlite3', 'mcap', 'lone mcap', 'lone db3')}


def read_all(path, options):
    """Every scan: a broken one is an InputError of its own, the others are read all the same."""
    from revisit.errors import InputError
    from revisit.recordings import open_recording
    recording = open_recording(path, **options)
    refused = None
    for scan in recording.scans():
        try:
            points = scan.points()
        except InputError as error:
            refused = error
            continue
        if points.dtype != np.float32 or points.ndim != 2 or points.shape[1] < 3:
            raise Fault(f'points of {points.dtype} {points.shape}')
        points.tobytes()
    recording.times()
    if refused:
        raise refused


def files_below(folder):
    return sorted(file for file in folder.rglob('*') if file.is_file())


def damaged_recording(make):
    def work(rng, folder):
        path, options = make(folder)
        damage(rng, rng.choice(files_below(folder)))
        read_all(path, options)
    return work


def right(make):
    def work(rng, folder):
        path, options = make(folder)
        try:
            read_all(path, options)
        except ImportError:
            raise
        except Exception as error:
            if make is not pcd:  # whose second file is none
                raise Fault(f'what is right is refused: {error}') from error
    return work


def loops_of_links(make):
    def work(rng, folder):
        path, options = make(folder)
        target = path if path.is_dir() else path.parent
        (target / 'loop').symlink_to(target)
        (target / 'self').symlink_to(target / 'self')
        for file in files_below(folder)[:1]:
            (file.parent / f'7{file.suffix}').symlink_to(file.parent / f'7{file.suffix}')
            (file.parent / f'8{file.suffix}').mkdir()
        read_all(path, options)
    return work


def special_files(make, what):
    """In the place of a scan: a FIFO that nobody writes to, a device without end, a folder."""
    def work(rng, folder):
        path, options = make(folder)
        scans = [file for file in files_below(folder) if file.suffix in ('.bin', '.ply', '.pcd', '.npy', '.bag', '.db3', '.mcap')]
        scans[0].unlink()
        {'fifo': lambda: os.mkfifo(scans[0]), 'zero': lambda: scans[0].symlink_to('/dev/zero'), 'folder': scans[0].mkdir}[what]()
        read_all(path, options)
    return work


def outside(name):
    """A table that names a file outside of the data set."""
    def work(rng, folder):
        inside = folder / 'inside'
        put(folder, 'secret/LIDAR_TOP/x.pcd.bin', columns(some_points(1), 12, 3))
        inside.mkdir()
        path, options = nuscenes(inside, filename=name.format(folder=folder))
        read_all(path, options)
        raise Fault('a file outside of the data set is read')
    return work


def table_of_nuscenes(change):
    def work(rng, folder):
        read_all(*nuscenes(folder, **change))
    return work


SAMPLE = {'token': 'd', 'sample_token': 'a', 'ego_pose_token': 'e', 'calibrated_sensor_token': 'c', 'timestamp': 1, 'filename': 'x/LIDAR_TOP/y'}
TABLES = {
    'deep': {'scene': '[' * 100000},
    'deep objects': {'scene': '{"a":' * 100000},
    'no list': {'scene': '7'},
    'no rows': {'scene': '[1]'},
    'object': {'scene': '{"name": 3}'},
    'null': {'sample_data': 'null'},
    'huge number': {'ego_pose': '[{"token": "e", "translation": [1e999, 1, 1], "rotation": [1,0,0,0]}]'},
    'digits': {'ego_pose': '[{"token": ' + '9' * 5000 + '}]'},
    'not UTF-8': {'scene': b'[{"token": "\xff"}]'},
    'surrogate': {'scene': '[{"token": "s", "name": "\\ud800"}]'},
    'name a number': {'scene': '[{"token": "s", "name": 61}]'},
    'file a number': {'sample_data': [SAMPLE | {'filename': 7}]},
    'NUL in name': {'sample_data': [SAMPLE | {'filename': 'x/LIDAR_TOP/\0'}]},
    'long name': {'sample_data': [SAMPLE | {'filename': 'x/LIDAR_TOP/' + 'y' * 5000}]},
    'surrogate in name': {'sample_data': [SAMPLE | {'filename': 'x/LIDAR_TOP/\ud800'}]},
    'time text': {'sample_data': [SAMPLE | {'timestamp': 'x'}]},
    'time huge': {'sample_data': [SAMPLE | {'timestamp': 10**400}]},
    'time null': {'sample_data': [SAMPLE | {'timestamp': None}] * 2},
    'rotation short': {'ego_pose': [{'token': 'e', 'translation': [1, 2, 3], 'rotation': [1]}]},
    'rotation huge': {'ego_pose': [{'token': 'e', 'translation': [1, 2, 3], 'rotation': [10**400, 1, 1, 1]}]},
    'rotation text': {'ego_pose': [{'token': 'e', 'translation': [1, 2, 3], 'rotation': 'abcd'}]},
    'translation deep': {'ego_pose': [{'token': 'e', 'translation': [[1, 2, 3]], 'rotation': [1, 0, 0, 0]}]},
    'token a list': {'scene': '[{"token": ["s"], "name": "scene-0061"}]'},
    'sample token a list': {'sample': '[{"token": ["a"], "scene_token": "s"}]'},
}


def cloud_case(rng, folder):
    """A message as rosbags gives it, with hostile numbers."""
    from bags import packed
    from revisit.recordings.point_cloud2 import points_of
    cloud = packed(some_points(1),
                   height=rng.choice([1, 2, 3]),
                   order=rng.choice('<>'),
                   types=rng.choice(['fff', 'ddd', 'fdf']),
                   offsets=rng.choice([(0, 8, 16), (16, 8, 0), (0, 0, 0)]),
                   step=26)
    huge = [0, 1, 2**16, 2**31 - 1, 2**31, 2**32 - 1, 2**63, 2**64 - 1]
    for name in rng.sample(['width', 'height', 'point_step', 'row_step', 'offset', 'count', 'datatype', 'name', 'data'], rng.choice([1, 2])):
        if name in ('offset', 'count', 'datatype'):
            setattr(rng.choice(cloud.fields), name, rng.choice(huge))
        elif name == 'name':
            rng.choice(cloud.fields).name = rng.choice(['x', 'y', '\ud800', ''])
        elif name == 'data':
            cloud.data = cloud.data[:rng.randrange(len(cloud.data))]
        else:
            setattr(cloud, name, rng.choice(huge))
    points_of(cloud).tobytes()


def pose_file(rng, folder):
    from revisit import poses
    lines = {'kitti': '1 0 0 0 0 1 0 0 0 0 1 0\n' * 4, 'tum': ''.join(f'{i} 1 2 3 0 0 0 1\n' for i in range(4)),
             'euroc': ''.join(f'{i},1,2,3,1,0,0,0\n' for i in range(4))}
    kind = rng.choice(list(lines))
    file = put(folder, 'poses.txt', damaged(rng, damaged(rng, lines[kind].encode())))
    found = poses.read_trajectory(file, rng.choice([None, kind]))
    if not np.isfinite(found.poses).all():
        raise Fault('poses that are not finite')
    poses.matched(found, [0, 1], [0.0, 1.0], 0.5)


def recordings():
    import revisit.recordings  # noqa: F401  once for all cases
    cases = [Case(f'{name}: right', right(make)) for name, make in KINDS.items()]
    cases += [Case(f'{name}: damaged {i}', damaged_recording(make)) for name, make in KINDS.items() for i in range(40)]
    cases += [Case(f'{name}: links', loops_of_links(make)) for name, make in KINDS.items()]
    cases += [
        Case(f'{name}: {what}', special_files(make, what)) for name, make in KINDS.items() if name != 'pcap'
        for what in ('fifo', 'zero', 'folder')
    ]
    cases += [Case(f'nuscenes: names {name}', outside(name)) for name in (
        '../secret/LIDAR_TOP/x.pcd.bin', '{folder}/secret/LIDAR_TOP/x.pcd.bin', 'samples/../../secret/LIDAR_TOP/x.pcd.bin')]
    cases += [Case(f'nuscenes: {name}', table_of_nuscenes(change)) for name, change in TABLES.items()]
    cases += [Case(f'PointCloud2 {i}', cloud_case) for i in range(100)]
    return cases + [Case(f'a file of poses {i}', pose_file) for i in range(60)]


# What is converted

class Runs:
    """A pickle that runs code: it makes a file."""

    def __init__(self, file):
        self.file = file

    def __reduce__(self):
        return os.system, (f'touch {self.file}',)


def convert(folder, *words):
    """Runs revisit-convert here. Its errors are one line and of a type; nothing is written then."""
    from revisit.conversion.__main__ import main
    before = set(folder.iterdir())
    code, said = capture(main, words)
    if 'Traceback' in said or code not in (0, 2, 3, 4, 5, 1):
        raise Fault(f'code {code}: {said[-500:]}')
    if (folder / 'pwned').exists():
        raise Fault('a file ran code')
    if code == 0:
        return
    if set(folder.iterdir()) - before:
        raise Fault(f'left {set(folder.iterdir()) - before} though it failed with {code}')
    said_lines = [line for line in said.splitlines() if line.startswith('revisit-convert: ')]
    if len(said_lines) != 1:
        raise Fault(f'code {code}, expected one line: {said}')
    line = said_lines[0]
    if "needs the Python package" in line or 'needs PyTorch' in line:
        raise ImportError(line)
    if code == 1 and re.match(r'revisit-convert: [\w.]*(Error|Exception|Warning|error)\b', line) and 'MemoryError' not in line:
        raise Fault(f'an error of no type of ours: {line}')
    raise ValueError(line)


def model(folder):
    from revisit.conversion import weights
    text = put(folder, 'n.prototxt', CONVOLVE)
    rng = np.random.default_rng(1)
    blobs = {'conv': [rng.normal(size=(4, 3, 3, 3)), rng.normal(size=4)], 'fc': [rng.normal(size=(5, 80)), rng.normal(size=5)]}
    blobs = {name: [array.astype(np.float32) for array in arrays] for name, arrays in blobs.items()}
    return text, blobs, weights


def weights_file(ending):
    def make(folder):
        _, blobs, weights = model(folder)
        weights.write(folder / f'w{ending}', blobs)
        return folder / f'w{ending}', lambda file: ('weights', file, folder / f'out{".npz" if ending != ".npz" else ".caffemodel"}')
    return make


def compressed_npz(folder):
    _, blobs, _ = model(folder)
    np.savez_compressed(folder / 'w.npz', **{f'{name}/{i}': array for name, arrays in blobs.items() for i, array in enumerate(arrays)})
    return folder / 'w.npz', lambda file: ('weights', file, folder / 'out.caffemodel')


def mean(ending):
    def make(folder):
        from revisit.conversion import means
        means.write(folder / f'mean{ending}', np.ones((3, 4, 5), np.float32))
        return folder / f'mean{ending}', lambda file: ('mean', file, folder / f'out{".npy" if ending != ".npy" else ".binaryproto"}')
    return make


def mat(compressed):
    def make(folder):
        import scipy.io
        from matconvnet_test import cell, conv, pool
        layers = [conv('conv1', 3, 3, 3, 4), dict(type='relu', name='relu1'), pool('pool1', 3, 2), dict(type='softmax', name='prob')]
        scipy.io.savemat(folder / 'net.mat',
                         dict(layers=cell(layers), normalization=dict(imageSize=np.array([[31.0, 37, 3]]))),
                         do_compression=compressed)
        return folder / 'net.mat', lambda file: ('matconvnet', file, folder / 'o.prototxt', folder / 'o.caffemodel')
    return make


def state(ending):
    def make(folder):
        from torchvision_test import squeezenet1_1
        arrays = squeezenet1_1()
        file = folder / f'state{ending}'
        if ending == '.safetensors':
            from safetensors.numpy import save_file
            save_file(arrays, file)
        elif ending == '.npz':
            np.savez_compressed(file, **{key: np.zeros_like(value) for key, value in arrays.items()})
        else:
            import torch
            torch.save({key: torch.from_numpy(value) for key, value in arrays.items()}, file)
        return file, lambda given: ('torch', 'squeezenet1_1', given, folder / 'o.prototxt', folder / 'o.caffemodel', '--no-check')
    return make


def normalised(folder):
    """A net that can be folded."""
    text, blobs, weights = model(folder)
    text.write_text(
        CONVOLVE.replace('layer { name: "relu"', 'layer { name: "bn" type: "BatchNorm" bottom: "conv" top: "conv" }\nlayer { name: "relu"'))
    return text, blobs | {'bn': [np.zeros(4, np.float32), np.ones(4, np.float32), np.ones(1, np.float32)]}, weights


def prototxt(folder):
    text, blobs, weights = normalised(folder)
    weights.write(folder / 'w.caffemodel', blobs)
    return text, lambda file: ('fold', file, folder / 'w.caffemodel', folder / 'o.prototxt', folder / 'o.caffemodel')


def to_onnx(folder):
    text, blobs, weights = model(folder)
    weights.write(folder / 'w.caffemodel', blobs)
    return text, lambda file: ('onnx', file, folder / 'w.caffemodel', folder / 'o.onnx')


def example(folder):
    text, blobs, weights = normalised(folder)
    weights.write(folder / 'w.caffemodel', blobs)
    np.save(folder / 'x.npy', np.ones((1, 3, 8, 10), np.float32))
    return folder / 'x.npy', lambda file: ('fold', text, folder / 'w.caffemodel', folder / 'o.prototxt', folder / 'o.caffemodel', '--input', file)


FILES = {'caffemodel': weights_file('.caffemodel'), 'h5': weights_file('.h5'), 'npz': weights_file('.npz'), 'compressed npz': compressed_npz,
         'binaryproto': mean('.binaryproto'), 'npy': mean('.npy'), 'mat': mat(False), 'compressed mat': mat(True),
         'safetensors': state('.safetensors'), 'state npz': state('.npz'), 'pth': state('.pth'), 'prototxt': prototxt, 'to onnx': to_onnx,
         'an example': example}


def damaged_file(make):
    def work(rng, folder):
        file, words = make(folder)
        damage(rng, file)
        convert(folder, *words(file))
    return work


def whole_file(make):
    def work(rng, folder):
        file, words = make(folder)
        convert_right(folder, *words(file))
    return work


def convert_right(folder, *words):
    try:
        convert(folder, *words)
    except ImportError:
        raise
    except Exception as error:
        raise Fault(f'what is right is refused: {error}') from error


def entry(descr="'<f4'", shape='(2,)', data=b'\0' * 8, version=1):
    head = f"{{'descr': {descr}, 'fortran_order': False, 'shape': {shape}, }}".encode()
    head += b' ' * (63 - (len(head) + 10) % 64) + b'\n'
    return b'\x93NUMPY' + bytes([version, 0]) + struct.pack('<H' if version == 1 else '<I', len(head)) + head + data


def zipped(entries, compression=zipfile.ZIP_DEFLATED, **zeros):
    out = io.BytesIO()
    with zipfile.ZipFile(out, 'w', compression, compresslevel=1) as file:
        for name, content in entries.items():
            file.writestr(name, content)
        for name, (head, megabytes) in zeros.items():
            with file.open(f'{name}/0.npy', 'w', force_zip64=True) as opened:
                opened.write(head)
                for _ in range(megabytes):
                    opened.write(bytes(1 << 20))
    return out.getvalue()


def twice():
    out = io.BytesIO()
    import warnings
    with warnings.catch_warnings(), zipfile.ZipFile(out, 'w') as file:
        warnings.simplefilter('ignore')
        file.writestr('a/0.npy', entry())
        file.writestr('a/0.npy', entry(data=b'\1' * 8))
    return out.getvalue()


def wrong_deflate():
    content = bytearray(zipped({'a/0.npy': entry(data=bytes(4000), shape='(1000,)')}))
    at = 30 + len('a/0.npy')
    content[at:at + 6] = b'\xff' * 6
    return bytes(content)


HOSTILE = {
    'bomb': lambda: zipped({}, a=(entry(shape=f'({3 << 27},)', data=b''), 3 << 9)),
    'bomb of bytes': lambda: zipped({}, a=(entry("'|i1'", shape=f'({3 << 29},)', data=b''), 3 << 9)),
    'bomb behind an array': lambda: zipped({}, a=(entry(), 3 << 9)),
    'huge shape': lambda: zipped({'a/0.npy': entry(shape='(10000000000000,)')}),
    'huge product': lambda: zipped({'a/0.npy': entry(shape='(4294967296, 4294967296)')}),
    'negative': lambda: zipped({'a/0.npy': entry(shape='(-1,)')}),
    'no data': lambda: zipped({'a/0.npy': entry(data=b'')}),
    'object': lambda: zipped({'a/0.npy': entry("'|O'", '()', pickle.dumps(7))}),
    'deep': lambda: zipped({'a/0.npy': entry('(' * 3000 + ')' * 3000)}),
    'deeper': lambda: zipped({'a/0.npy': entry('[' * 60000, version=2)}),
    'code': lambda: zipped({'a/0.npy': entry("__import__('os').system('touch pwned')")}),
    'names that climb': lambda: zipped({'../../a/0.npy': entry(), '/etc/x/0.npy': entry()}),
    'one name twice': twice,
    'not arrays': lambda: zipped({'a/0.npy': b'text', 'b/0': b''}),
    'folder': lambda: zipped({'a/0.npy/': b''}),
    'lzma': lambda: zipped({'a/0.npy': entry()}, zipfile.ZIP_LZMA),
    'bz2': lambda: zipped({'a/0.npy': entry()}, zipfile.ZIP_BZIP2),
    'unknown compression': lambda: zipped({'a/0.npy': entry()}).replace(b'\x14\0\0\0\x08\0', b'\x14\0\0\0\x63\0'),
    'encrypted': lambda: zipped({'a/0.npy': entry()}).replace(b'\x14\0\0\0\x08\0', b'\x14\0\1\0\x08\0'),
    'wrong deflate': wrong_deflate,
    'many': lambda: zipped({f'a{i}/0.npy': entry() for i in range(30000)}, zipfile.ZIP_STORED),
    'complex': lambda: zipped({'a/0.npy': entry("'<c8'")}),
    'structured': lambda: zipped({'a/0.npy': entry("[('x', '<f4')]", '(2,)')}),
    'empty shape': lambda: zipped({'a/0.npy': entry(shape='(0, 4294967296, 4294967296)', data=b'')}),
    'no entries': lambda: zipped({}),
    'NaN': lambda: zipped({'a/0.npy': entry(data=b'\xff' * 8)}),
    'float16 of text': lambda: zipped({'a/0.npy': entry("'<U4'", '(1,)', b'1\0\0\0' * 4)}),
    'void': lambda: zipped({'a/0.npy': entry("'|V0'", '(1000000000,)', b'')}),
    'huge item': lambda: zipped({'a/0.npy': entry("'|V2147483647'", '(1,)', b'')}),
    'no items of no bytes': lambda: zipped({'a/0.npy': entry("'<f4'", '(True,)')}),
}


def zip_case(name, command_of):
    def work(rng, folder):
        put(folder, 'w.npz', HOSTILE[name]())
        os.chdir(folder)
        convert(folder, *command_of(folder))
    return work


def npy_case(shape, descr, data):
    def work(rng, folder):
        put(folder, 'mean.npy', entry(descr, shape, data))
        os.chdir(folder)
        convert(folder, 'mean', folder / 'mean.npy', folder / 'out.binaryproto')
    return work


def pickled(name):
    """Whatever the ending: no pickle runs."""
    def work(rng, folder):
        put(folder, name, pickle.dumps(Runs(folder / 'pwned')))
        if name.endswith('.npz'):
            put(folder, name, zipped({'a/0.npy': entry("'|O'", '()', pickle.dumps(Runs(folder / 'pwned')))}))
        elif name.endswith('.npy'):
            put(folder, name, entry("'|O'", '(1, 1, 1)', pickle.dumps(Runs(folder / 'pwned'))))
        words = {'npz': ('weights', folder / name, folder / 'o.caffemodel'), 'npy': ('mean', folder / name, folder / 'o.binaryproto'),
                 'mat': ('matconvnet', folder / name, folder / 'o.prototxt', folder / 'o.caffemodel'),
                 'h5': ('weights', folder / name, folder / 'o.caffemodel'), 'caffemodel': ('weights', folder / name, folder / 'o.npz')}
        ending = name.rpartition('.')[2]
        words = words.get(ending, ('torch', 'alexnet', folder / name, folder / 'o.prototxt', folder / 'o.caffemodel'))
        convert(folder, *words)
    return work


def mat_bomb(rng, folder):
    """A compressed element of zeros, as large as it says."""
    packer = zlib.compressobj(1)
    size = 3 << 29
    array = struct.pack('<IIII', 6, 8, 6, 0) + struct.pack('<IIii', 5, 8, 1, size // 8) + struct.pack(
        '<II', 1, 6) + b'layers\0\0' + struct.pack('<II', 9, size)
    packed = packer.compress(struct.pack('<II', 14,
                                         len(array) + size) + array) + b''.join(
                                             packer.compress(bytes(1 << 24)) for _ in range(size >> 24)) + packer.flush()
    put(folder, 'net.mat',
        b'MATLAB 5.0 MAT-file'.ljust(116) + bytes(8) + struct.pack('<H', 0x100) + b'IM' + struct.pack('<II', 15, len(packed)) + packed)
    convert(folder, 'matconvnet', folder / 'net.mat', folder / 'o.prototxt', folder / 'o.caffemodel')


def mat_deep(rng, folder):
    import scipy.io
    value = np.zeros((1, 1))
    for _ in range(60):
        box = np.empty((1, 1), object)
        box[0, 0] = value
        value = box
    scipy.io.savemat(folder / 'net.mat', {'layers': value})
    convert(folder, 'matconvnet', folder / 'net.mat', folder / 'o.prototxt', folder / 'o.caffemodel')


def converters():
    import revisit.conversion.commands  # noqa: F401  once for all cases
    import revisit.engine  # noqa: F401
    cases = [Case(f'{name}: right', whole_file(make), 1500) for name, make in FILES.items()]
    cases += [Case(f'{name}: damaged {i}', damaged_file(make), 600) for name, make in FILES.items()
              for i in range(15 if name in ('safetensors', 'state npz', 'pth', 'to onnx') else 40)]
    to_weights = lambda folder: ('weights', folder / 'w.npz', folder / 'out.caffemodel')  # noqa: E731
    to_state = lambda folder: ('torch', 'alexnet', folder / 'w.npz', folder / 'o.prototxt', folder / 'o.caffemodel')  # noqa: E731
    cases += [Case(f'npz: {name}', zip_case(name, to_weights)) for name in HOSTILE]
    cases += [Case(f'state npz: {name}', zip_case(name, to_state)) for name in HOSTILE]
    cases += [
        Case(f'npy: {shape} {descr}', npy_case(shape, descr, data))
        for shape, descr, data in (('(10000000000000,)', "'<f4'", b''), ('(4294967296, 4294967296)', "'<f4'", b''),
                                   ('(-1,)', "'<f4'", bytes(8)), ('()', "'<f4'", bytes(4)), ('(1, 1, 2)', "'|O'", pickle.dumps(1)),
                                   ('(' * 500, "'<f4'", b''), ("__import__('os').system('touch pwned')", "'<f4'",
                                                               b''), ('(0, 3, 4)', "'<f4'", b''), ('(1, 1, 1000000000)', "'|V0'", b''),
                                   ('(1, 1, 2)', "'<f4'", b'\xff' * 8), ('(3000000000,)', "'|i1'", b''))
    ]
    cases += [
        Case(f'a pickle as {name}', pickled(name))
        for name in ('w.npz', 'm.npy', 'n.mat', 'w.h5', 'w.caffemodel', 's.pth', 's.pt', 's.safetensors', 's.bin')
    ]
    return cases + [Case('mat: a bomb', mat_bomb), Case('mat: deep', mat_deep)]

