"""Arrays of every type, order, stride and size into every function that takes some.

Equal numbers in other layouts must give equal answers. A seeded sample of other arrays must give an answer or an error of a
documented type; REVISIT_ARRAYS=all tests all of them.
"""

import functools
import os
import random
import re
import tempfile
import unittest
from pathlib import Path

import numpy as np

from children import Fault, faults_of
from nets import CONVOLVE, SCALE
from scans import room

SAMPLE = 8 if os.environ.get('REVISIT_ARRAYS') != 'all' else 1000  # other arrays per function
LONG = ('caffe.Net.forward_all', 'caffe.io.resize_image')


class Subclass(np.ndarray):
    pass


class Interface:
    def __init__(self, array):
        self.array = array
        self.__array_interface__ = array.__array_interface__


class Liar:
    """Raises ValueError on every access; callers may let it propagate."""

    def __getattr__(self, name):
        raise ValueError(f'the liar has no {name}')


def apart(array):
    large = np.zeros(tuple(2 * n for n in array.shape), array.dtype)
    view = large[tuple(slice(None, None, 2) for _ in array.shape)]
    view[...] = array
    return view


def unaligned(array):
    raw = bytearray(array.nbytes + 1)
    view = np.ndarray(array.shape, array.dtype, raw, 1)
    view[...] = array
    return view


def read_only(array):
    copy = array.copy()
    copy.flags.writeable = False
    return copy


SAME = {  # equal numbers in other layouts
    'read-only': read_only,
    'Fortran': np.asfortranarray,
    'every other': apart,
    'negative': lambda a: a[tuple(slice(None, None, -1) for _ in a.shape)].copy()[tuple(slice(None, None, -1) for _ in a.shape)],
    'negative rows': lambda a: a[::-1].copy()[::-1],
    'transposed': lambda a: a.T.copy().T,
    'unaligned': unaligned,
    'subclass': lambda a: a.view(Subclass),
    'memoryview': lambda a: memoryview(a),
    'list': lambda a: a.tolist(),
    'interface': Interface,
    'not masked': lambda a: np.ma.masked_array(a, np.zeros(a.shape, bool)),
    'broadcast axis of one': lambda a: np.lib.stride_tricks.as_strided(a[None], (1, *a.shape), (12345, *a.strides))[0],
}
MASKS_DO_NOT_COUNT = ('caffe.', 'poses.')  # as in pycaffe, or in Python only
OTHER = {
    **{f'type {code}': (lambda a, code=code: np.zeros(a.shape, code) if np.dtype(code).kind in 'mM' else a.astype(code))
       for code in ['?', 'b', 'h', 'i', 'l', 'q', 'B', 'H', 'I', 'L', 'Q', 'e', 'f', 'd', 'g', 'F', 'D', 'G', 'S4', 'U4', 'V4', 'O', 'm8[s]',
                    'M8[s]', '>f4', '>f8', '>i4', 'f4,f4', '3f4']},
    'empty': lambda a: a[:0],
    'empty inside': lambda a: a[..., :0],
    'no axes': lambda a: a.ravel()[0:1].reshape(()),
    'number': lambda a: a.ravel()[0],
    'one axis': lambda a: a.ravel(),
    'five axes': lambda a: a.reshape((1, 1, 1, *a.shape)),
    'sixty axes': lambda a: a.reshape((1,) * (60 - a.ndim) + a.shape),
    'one more': lambda a: np.concatenate([a, a[:1]]),
    'one less': lambda a: a[:-1],
    'zero stride': lambda a: np.broadcast_to(a[:1], a.shape),
    'zero strides': lambda a: np.broadcast_to(a.ravel()[:1].reshape((1,) * a.ndim), a.shape),
    'huge': lambda a: np.broadcast_to(a[:1], (10**10, *a.shape[1:])),
    'huger': lambda a: np.broadcast_to(a.ravel()[:1].reshape((1,) * a.ndim), (2**61, *(1,) * (a.ndim - 1))),
    'huge and empty': lambda a: np.zeros((0, *(2**15,) * (a.ndim - 1)), a.dtype) if a.ndim > 1 else a[:0],
    'NaN': lambda a: np.full_like(a, np.nan),
    'infinite': lambda a: np.full_like(a, np.inf),
    'minus infinite': lambda a: np.where(np.arange(a.size).reshape(a.shape) % 2, a, -np.inf).astype(a.dtype),
    'largest': lambda a: np.full_like(a, np.finfo(a.dtype).max),
    'denormal': lambda a: np.full_like(a, np.finfo(a.dtype).smallest_subnormal),
    'zeros': np.zeros_like,
    'masked': lambda a: np.ma.masked_array(a, np.arange(a.size).reshape(a.shape) % 2 == 0),
    'matrix': lambda a: np.asmatrix(a.reshape(a.shape[0], -1)),
    'None': lambda a: None,
    'text': lambda a: 'array',
    'bytes': lambda a: a.tobytes(),
    'dict': lambda a: {0: a},
    'function': lambda a: len,
    'type': lambda a: np.ndarray,
    'liar': lambda a: Liar(),
    'tuple of three': lambda a: (a, a, a),
    'list of rows': lambda a: list(a),
    'tuple of Nones': lambda a: (None, None, None),
    'structured': lambda a: np.array([(1, 2, 3)] * len(a), [('x', 'f4'), ('y', 'f4'), ('z', 'f4')]),
    'structured, swapped': lambda a: np.array([(1, 2, 3)] * len(a), [('x', '>f4'), ('y', 'f4'), ('z', 'f4')]),
    'structured, double': lambda a: np.array([(1, 2, 3)] * len(a), [('x', 'f8'), ('y', 'f8'), ('z', 'f8')]),
    'structured, arrays': lambda a: np.zeros(len(a), [('x', 'f4', 3), ('y', 'f4'), ('z', 'f4')]),
    'structured, no z': lambda a: np.zeros(len(a), [('x', 'f4'), ('y', 'f4')]),
    'structured, backwards': lambda a: np.array([(1, 2, 3)] * len(a), [('x', 'f4'), ('y', 'f4'), ('z', 'f4')])[::-1],
    'structured, overlapping': lambda a: np.zeros(len(a), np.dtype({'names': 'xyz', 'formats': ['f4'] * 3, 'offsets': [0, 1, 2], 'itemsize': 6})),
    'structured, standing': lambda a: np.broadcast_to(np.array([(1, 2, 3)], [('x', 'f4'), ('y', 'f4'), ('z', 'f4')]), len(a)),
}


def net_of(text):
    from revisit import engine
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / 'net.prototxt'
        file.write_text(text)
        return engine.Net.load_with_random_weights(file, 1)


def caffe_net(folder, text):
    import revisit.caffe as caffe
    file = folder / 'net.prototxt'
    file.write_text(text)
    return caffe.Net(str(file), caffe.TEST)


def targets():
    """Returns name -> (valid array, function(array, folder) -> numbers to compare or None)."""
    import revisit
    from revisit import datasets, evaluation, proto, recognition
    points = room(1)[::40].copy()
    rng = np.random.default_rng(1)
    vector, pose = rng.normal(size=64).astype(np.float32), np.eye(4)
    pose[:3, 3] = 1, 2, 3
    found = {}

    def points_into(name, work):
        found[name] = (points, lambda a, folder: work(a))

    points_into('project', recognition.project)
    points_into('scan_to_image', lambda a: recognition.scan_to_image(a, 'case1'))
    points_into('principal_alignment', lambda a: recognition.principal_alignment(a).R_aligned_sensor)
    points_into('from_scan', lambda a: recognition.from_scan(recognition.m2dp_features())(a))
    points_into('describe', lambda a: revisit.open_map(None).describe(a).feature.copy())

    def written(a, folder):
        datasets.write_kitti_scan(folder / 'a.bin', a)
        return datasets.read_scan(folder / 'a.bin')
    found['write_kitti_scan'] = (points, written)
    try:
        from revisit import registration
        points_into('PreparedScan', lambda a: registration.PreparedScan(a).points.copy())
    except ImportError:
        pass
    found['cosine'] = (vector, lambda a, folder: np.float64(recognition.cosine(a, vector)))
    image = rng.normal(size=(1, 3, 8, 10)).astype(np.float32)

    def forward(a, folder, by):
        run = net_of(CONVOLVE).plan(keep_all=True).run()
        if by == 'set':
            run.set_input('data', a)
            run.forward()
        elif by == 'view':
            run.input('data')[...] = a
            run.forward()
        else:
            run.forward({'data': a})
        return run.output('prob').copy()
    found['Run.set_input'] = (image, lambda a, folder: forward(a, folder, 'set'))
    found['Run.forward'] = (image, lambda a, folder: forward(a, folder, 'forward'))
    found['caffe.Net.forward'] = (
        image, lambda a, folder: caffe_net(folder, SCALE.replace('dim: 2 dim: 3', 'dim: 1 dim: 3 dim: 8 dim: 10')).forward(data=a)['out'])
    found['caffe.Net.forward_all'] = (
        image,
        lambda a, folder: caffe_net(folder, SCALE.replace('dim: 2 dim: 3', 'dim: 1 dim: 3 dim: 8 dim: 10')).forward_all(data=a)['out'])

    def transformed(a):
        import revisit.caffe as caffe
        transformer = caffe.io.Transformer({'data': (1, 3, 8, 10)})
        transformer.set_transpose('data', (2, 0, 1))
        transformer.set_channel_swap('data', (2, 1, 0))
        return transformer.preprocess('data', a)
    found['caffe.io.Transformer'] = (np.abs(image[0].transpose(1, 2, 0)).copy(), lambda a, folder: transformed(a))

    def through_datum(a):
        import revisit.caffe as caffe
        return caffe.io.datum_to_array(caffe.io.array_to_datum(a))
    found['caffe.io.array_to_datum'] = (image[0], lambda a, folder: through_datum(a))

    def through_blob(a):
        import revisit.caffe as caffe
        return caffe.io.blobproto_to_array(caffe.io.array_to_blobproto(a))
    found['caffe.io.array_to_blobproto'] = (image, lambda a, folder: through_blob(a))

    def resized(a):
        import revisit.caffe as caffe
        return caffe.io.resize_image(a, (5, 7))
    found['caffe.io.resize_image'] = (np.abs(image[0].transpose(1, 2, 0)).copy(), lambda a, folder: resized(a))

    def weighed(a):
        file = proto.parse_net(CONVOLVE)
        file.set_weights({'fc': [a]})
        return np.frombuffer(file.to_bytes(), np.uint8)
    found['NetFile.set_weights'] = (rng.normal(size=(5, 80)).astype(np.float32), lambda a, folder: weighed(a))

    descriptors = rng.normal(size=(12, 8)).astype(np.float32)
    trajectory = evaluation.Trajectory(list(range(12)), np.repeat(np.arange(12.0) % 6, 3).reshape(12, 3) * 10)
    def retrieved(a):
        tasks = evaluation.make_tasks('leave-one-out', '00', trajectory, 'none')
        return np.array([match.score for match in evaluation.retrieve(a, tasks[0])])
    found['retrieve'] = (descriptors, lambda a, folder: retrieved(a))
    found['fit_pca'] = (rng.normal(size=(40, 8)).astype(np.float32), lambda a, folder: recognition.fit_pca(a, 4).descriptors.copy())
    found['Trajectory'] = (np.arange(36.0).reshape(12, 3), lambda a, folder: evaluation.Trajectory(list(range(12)), a) and None)
    found['labels'] = (rng.normal(size=9), lambda a, folder: np.array([v.score for v in evaluation.labels(a, np.ones(9, bool))]))
    found['labels, correct'] = (np.arange(9) % 2 == 0, lambda a, folder: np.array([v.correct for v in evaluation.labels(np.ones(9), a)]))

    def added(a):
        map_ = revisit.open_map(None)
        scan = map_.describe(room(1))
        map_.add(scan, pose=a)
        return map_.query(scan).pose
    found['add, pose'] = (pose, lambda a, folder: added(a))

    return found


def same(a, b) -> bool:
    if (a is None) != (b is None):
        return False
    return a is None or np.array_equal(np.asarray(a), np.asarray(b), equal_nan=np.asarray(a).dtype.kind in 'fc')


def check_same(make, array, work):
    given = make(array)
    try:
        answer = work(given)
    except Exception as error:
        if isinstance(given, np.ndarray) and not re.search('C order|C-contiguous|masked', str(error)):
            raise Fault(f'rejects an array of valid numbers: {error}') from error
        raise
    if not same(answer, work(array.copy())):
        raise Fault('another answer than for the same numbers in C order')


def check_other(name, how, make, array, work):
    try:
        given = make(array)
    except Exception as error:
        raise ImportError(f'there is no such array: {error}') from None
    if how.startswith('huge') and name in LONG:
        return  # as much work as requested
    work(given)
    if how == 'masked' and not name.startswith(MASKS_DO_NOT_COUNT):
        raise Fault('masked values count')


class Arrays(unittest.TestCase):
    def test_layouts_and_types(self):
        rng = random.Random(1)
        for name, (array, work) in targets().items():
            with self.subTest(name), tempfile.TemporaryDirectory() as folder:
                work_in = functools.partial(work, folder=Path(folder))
                work_in(array)  # valid
                cases = [(how, functools.partial(check_same, make, array, work_in)) for how, make in SAME.items()]
                others = list(OTHER.items())
                cases += [(how, functools.partial(check_other, name, how, make, array, work_in))
                          for how, make in rng.sample(others, min(SAMPLE, len(others)))]
                self.assertEqual(faults_of(cases), [])


if __name__ == '__main__':
    unittest.main()
