"""Untrusted files: recordings, and inputs of conversion."""

import functools
import json
import os
import re
import struct

import numpy as np

from harness import Case, Fault, accepted, capture, damage, damaged
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


# Functions that write each kind of recording into a folder and return (path, options)

def columns(points, *more):
    return np.concatenate([points, *[np.full((len(points), 1), value, np.float32) for value in more]], 1).tobytes()


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


def nuscenes(folder):
    name = 'samples/LIDAR_TOP/n015__LIDAR_TOP__1532402927647951.pcd.bin'
    put(folder, name, columns(some_points(1), 12, 3))
    tables = {
        'scene': [{'token': 's', 'name': 'scene-0061'}], 'sample': [{'token': 'a', 'scene_token': 's'}],
        'calibrated_sensor': [{'token': 'c', 'translation': [1, 0, 1.8], 'rotation': [0.7071068, 0, 0, -0.7071068]}],
        'ego_pose': [{'token': 'e', 'translation': [10, 20, 0], 'rotation': [1, 0, 0, 0]}],
        'sample_data': [{'token': 'd', 'sample_token': 'a', 'ego_pose_token': 'e', 'calibrated_sensor_token': 'c',
                         'timestamp': 1532402927647951, 'filename': name}]}
    for table, rows in tables.items():
        put(folder, f'v1.0-mini/{table}.json', json.dumps(rows))
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


KINDS = {'npy': npy, 'mulran': mulran, 'helipr': helipr, 'nclt': nclt, 'kitti_360': kitti_360,
         'nuscenes': nuscenes, 'pcap': pcap} | {kind: functools.partial(bag, kind) for kind in ('ros1', 'sqlite3', 'mcap', 'lone mcap', 'lone db3')}


def read_all(path, options):
    """Reads every scan: a broken one must raise its own InputError, and the others must still be readable."""
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
    return accepted(lambda rng, folder: read_all(*make(folder)))


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
    return cases + [Case(f'a file of poses {i}', pose_file) for i in range(60)]



def convert(folder, *words):
    """Runs revisit-convert here. An error must be one line of a known type, without output files."""
    from revisit.conversion.__main__ import main
    before = set(folder.iterdir())
    code, said = capture(main, words)
    if 'Traceback' in said or code not in (0, 2, 3, 4, 5, 1):
        raise Fault(f'code {code}: {said[-500:]}')
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


def mean(ending):
    def make(folder):
        from revisit.conversion import files
        files.write_mean(folder / f'mean{ending}', np.ones((3, 4, 5), np.float32))
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


def to_onnx(folder):
    text, blobs, weights = model(folder)
    weights.write(folder / 'w.caffemodel', blobs)
    return text, lambda file: ('onnx', file, folder / 'w.caffemodel', folder / 'o.onnx')


def example(folder):
    text, blobs, weights = model(folder)
    bn = 'layer { name: "bn" type: "BatchNorm" bottom: "conv" top: "conv" }\n'
    text.write_text(CONVOLVE.replace('layer { name: "relu"', bn + 'layer { name: "relu"'))
    weights.write(folder / 'w.caffemodel', blobs | {'bn': [np.zeros(4, np.float32), np.ones(4, np.float32), np.ones(1, np.float32)]})
    np.save(folder / 'x.npy', np.ones((1, 3, 8, 10), np.float32))
    return folder / 'x.npy', lambda file: ('fold', text, folder / 'w.caffemodel', folder / 'o.prototxt', folder / 'o.caffemodel', '--input', file)


FILES = {'caffemodel': weights_file('.caffemodel'), 'h5': weights_file('.h5'), 'npz': weights_file('.npz'),
         'binaryproto': mean('.binaryproto'), 'npy': mean('.npy'), 'mat': mat(False), 'compressed mat': mat(True),
         'safetensors': state('.safetensors'), 'state npz': state('.npz'), 'pth': state('.pth'), 'to onnx': to_onnx, 'an example': example}


def file_of(make, change):
    def work(rng, folder):
        file, words = make(folder)
        change(rng, file)
        convert(folder, *words(file))
    return work


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
    import revisit.conversion.__main__  # noqa: F401  once for all cases
    import revisit.engine  # noqa: F401
    cases = [Case(f'{name}: right', accepted(file_of(make, lambda rng, file: None)), 1500) for name, make in FILES.items()]
    cases += [Case(f'{name}: damaged {i}', file_of(make, damage), 600) for name, make in FILES.items()
              for i in range(15 if name in ('safetensors', 'state npz', 'pth', 'to onnx') else 40)]
    return cases + [Case('mat: deep', mat_deep)]
