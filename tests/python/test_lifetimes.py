"""Lifetimes of arrays and objects, and concurrent use of one object."""

import contextlib
import functools
import gc
import os
import subprocess
import sys
import threading
import time
import unittest

import numpy as np

from children import Fault, faults_of
from folders import FolderTest
from nets import CONVOLVE, SCALE
from scans import room
from test_arrays import caffe_net, net_of

IMAGE = np.random.default_rng(2).normal(size=(1, 3, 8, 10)).astype(np.float32)


def churn():
    gc.collect()
    return [np.full(n, np.nan, np.float32) for n in range(1, 5000, 7)]


def stays(make):
    """Creates a case: arrays of make(folder) must keep their numbers after their owners are freed."""
    def work(folder):
        arrays, copies = make(folder)
        held = churn()
        for array, copy in zip(arrays, copies, strict=True):
            if not np.array_equal(array, copy, equal_nan=True):
                raise Fault('an array changed when its owner had gone')
        del held
    return work


def both(arrays):
    arrays = list(arrays)
    return arrays, [array.copy() for array in arrays]


def of_run(folder):
    run = net_of(CONVOLVE).plan(keep_all=True).run()
    run.forward({'data': IMAGE})
    return both([run.input('data'), run.output('prob'), run.layer_output('conv'), *run.outputs().values()])


def of_file(folder):
    from revisit import proto
    file = proto.parse_net(CONVOLVE)
    file.set_weights({'fc': [np.arange(12, dtype=np.float32).reshape(3, 4)]})
    return both(proto.WeightsFile.from_bytes(file.to_bytes()).read(0))


def of_description(folder):
    import revisit
    return both([revisit.open_map(None).describe(room(1)).feature])


def of_entries(folder):
    import revisit
    from revisit import maps
    map_ = revisit.open_map(folder / 'm.map')
    for seed in range(3):
        map_.add(map_.describe(room(seed)))
    del map_
    gc.collect()
    entries = maps.MapStore.open(folder / 'm.map').entries()
    return both([array for entry in entries for array in (entry.feature, entry.descriptor)])


def of_points(folder):
    from revisit import datasets
    datasets.write_kitti_scan(folder / 'a.bin', room(1))
    array = datasets.read_scan(folder / 'a.bin')
    (folder / 'a.bin').write_bytes(b'')
    return both([array])


def of_prepared(folder):
    from revisit import registration
    return both([registration.PreparedScan(room(1)).points])


def of_curve(folder):
    from revisit import evaluation
    return both(evaluation.precision_recall(evaluation.labels(np.arange(9.0), np.arange(9) % 2 == 0)).values())


def given_goes(folder):
    """Callers may free or change arguments after a call."""
    import revisit
    from revisit import proto
    scan = room(1)
    map_ = revisit.open_map(None)
    before = map_.describe(scan)
    feature = before.feature.copy()
    scan[...] = 0
    del scan
    held = churn()
    if not np.array_equal(before.feature, feature):
        raise Fault('a description changed with the scan')
    content = proto.parse_net(CONVOLVE).to_bytes()
    file = proto.WeightsFile.from_bytes(bytes(bytearray(content)))
    del content
    churn()
    file.layers
    del held


def changes_meanwhile(folder):
    """Another thread writes to a scan during a call: any single answer is correct."""
    import revisit
    map_, scan, end = revisit.open_map(None), room(1), threading.Event()

    def scribble():
        while not end.is_set():
            scan[len(scan) // 2:, :3] *= np.float32(-1.01)
    thread = threading.Thread(target=scribble)
    thread.start()
    for _ in range(5):
        map_.describe(scan)
    end.set()
    thread.join()


def gone_during_pass(folder):
    run = net_of(CONVOLVE).plan(threads=2).run()
    runs = [run]
    thread = threading.Thread(target=lambda: [runs[0].forward({'data': IMAGE}) for _ in range(50) if runs])
    thread.start()
    time.sleep(0.01)
    del run
    runs.clear()
    gc.collect()
    thread.join()


def map_after_fork(folder):
    """A forked child must not use or corrupt the parent's map."""
    import revisit
    from revisit import maps
    map_ = revisit.open_map(folder / 'm.map')
    map_.add(map_.describe(room(1)))
    child = os.fork()
    if child == 0:
        try:
            map_.query(map_.describe(room(1)))
        finally:
            os._exit(0)
    os.waitpid(child, 0)
    map_.add(map_.describe(room(2)))
    del map_
    gc.collect()
    if maps.check_map(folder / 'm.map') or len(maps.MapStore.open(folder / 'm.map')) != 2:
        raise Fault('the map is corrupt')


BEGIN = """
import sys, threading, atexit, gc, time, os, numpy as np
sys.path[:0] = {path!r}
from test_arrays import net_of; from nets import CONVOLVE; from scans import room
import revisit, revisit.maps
from revisit.engine import profile
image = np.zeros((1, 3, 8, 10), np.float32)
net = net_of(CONVOLVE); run = net.plan(threads={threads}).run()
def work(n=10**9):
    mine = net.plan(threads={threads}).run()
    for _ in range(n): mine.forward({{'data': image}})
def describe(n=10**9):
    map_ = revisit.open_map(None); scan = room(1)
    for _ in range(n): map_.add(map_.describe(scan))
"""
ENDS = {
    'daemon in a pass': 'threading.Thread(target=work, daemon=True).start(); time.sleep(0.05)',
    'daemons in passes': '[threading.Thread(target=work, daemon=True).start() for _ in range(4)]; time.sleep(0.1)',
    'daemon in a profile': 'threading.Thread(target=profile, args=(run,), kwargs={"repeat": 10**9}, daemon=True).start(); time.sleep(0.05)',
    'daemons in copies': """apart = np.zeros(3 * 600 * 600, [('odd', 'u1'), ('x', 'f4')])['x'].reshape(1, 3, 600, 600)  # numpy copies it without the GIL
plan = net.part('conv', 'conv').plan({'data': apart.shape})
def copies(mine):
    while True: mine.set_input('data', apart)
[threading.Thread(target=copies, args=(plan.run(),), daemon=True).start() for _ in range(2)]; time.sleep(0.1)""",
    'daemon in describe': 'threading.Thread(target=describe, daemon=True).start(); time.sleep(0.1)',
    'thread still working': 'threading.Thread(target=work, args=(200,)).start()',
    'atexit': 'atexit.register(lambda: work(3)); atexit.register(lambda: describe(1))',
    'globals in a cycle': 'a = [run, net]; a.append(a); held = run.input("data")',
    'kept by a module': 'sys.modules["kept"] = run; import builtins; builtins.kept = run.output',
    'raise in a thread': 'def bad():\n    run.forward({"data": 1})\nt = threading.Thread(target=bad); threading.excepthook = lambda *a: None; t.start(); t.join()',
    'del at exit': 'class Late:\n    def __init__(self): self.net = net\n    def __del__(self): self.net.plan()\nlate = Late()',
    'del in a cycle': 'class Late:\n    def __init__(self): self.net = net; self.me = self\n    def __del__(self): self.net.plan().run().forward({"data": image})\nLate()',
    'os._exit in a pass': 'threading.Thread(target=work, daemon=True).start(); time.sleep(0.05); os._exit(0)',
    'sys.exit in a thread': 'threading.Thread(target=lambda: (work(2), sys.exit(3))).start()',
    'open map': 'r = revisit.open_map("m.map"); r.add(r.describe(room(1))); threading.Thread(target=lambda: [r.add(r.describe(room(1))) for _ in range(10**6)], daemon=True).start(); time.sleep(0.3)',
    'generator': 'def g():\n    mine = net.plan().run()\n    while True:\n        mine.forward({"data": image}); yield mine.output("prob")\nit = g(); next(it)',
    'fork in a pass': 'threading.Thread(target=work, daemon=True).start(); time.sleep(0.05)\nif os.fork() == 0: work(2); sys.exit(0)\nos.wait()',
}


def together(*works):
    errors, gate = [], threading.Barrier(len(works))

    def guarded(work):
        try:
            gate.wait()
            work()
        except BaseException as error:
            errors.append(error)
    threads = [threading.Thread(target=guarded, args=(work,)) for work in works]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    if errors:
        raise errors[0]


def often(call, times=40):
    from revisit.errors import UsageError

    def work():
        for i in range(times):
            with contextlib.suppress(UsageError):
                call(i)
    return work


def one_run_mixed(folder):
    from revisit import engine
    run = net_of(CONVOLVE).plan(threads=2, keep_all=True).run()
    together(often(lambda _: run.forward({'data': IMAGE})), often(lambda _: run.set_input('data', IMAGE)), often(lambda _: run.outputs()),
             often(lambda _: run.layer_output('conv').copy()), often(lambda _: engine.profile(run, warmup=0, repeat=1)),
             often(lambda _: run.plan.layers), often(lambda _: gc.collect()), often(lambda _: run.input('data').fill(1)))


def shared_map(store):
    def work(folder):
        import revisit
        from revisit import maps
        file = folder / 'm.map' if store else None
        map_ = revisit.open_map(file, warmup=8)
        scans = [room(seed)[::4].copy() for seed in range(6)]
        first = map_.describe(scans[0])
        map_.add(first)

        def add(k):
            def all_of():
                for i in range(6):
                    map_.add(map_.describe(scans[i]), drive=str(k), frame=i)
            return all_of

        def query():
            for i in range(30):
                map_.query(first, [0])
                len(map_), map_.sensor, map_.warnings
                map_.refresh()

        together(*[add(k) for k in range(4)], query, query, often(lambda i: map_.remove([i]), 5))
        removed = map_.remove(list(range(5)))
        if len(map_) != 25:  # indices stay
            raise Fault(f'{len(map_)} entries, expected 25 ({removed} removed last)')
        if store:
            del map_
            gc.collect()
            if maps.check_map(file) or len(maps.MapStore.open(file)) != 20:
                raise Fault(f'the map: {maps.check_map(file)}')
    return work


def one_map(folder):
    """Reads, removes and closes concurrently."""
    import revisit
    from revisit import maps
    map_ = revisit.open_map(folder / 'm.map')
    for seed in range(8):
        map_.add(map_.describe(room(seed)[::8]))
    del map_
    gc.collect()
    map_ = maps.MapStore.open(folder / 'm.map', write=True)
    together(often(lambda i: map_.entries()), often(lambda i: map_.remove([1 + i % 8])), often(lambda i: len(map_)),
             often(lambda i: map_.removed()), often(lambda i: i == 30 and map_.close()),
             often(lambda i: revisit.open_map(folder / 'other.map'), 1))


def gone_elsewhere(folder):
    """Drops maps in the garbage collector of another thread."""
    import revisit
    scan = room(1)[::8]

    def make(k):
        def work():
            for i in range(6):
                map_ = revisit.open_map(folder / f'{k}-{i}.map')
                map_.add(map_.describe(scan))
                cycle = [map_]
                cycle.append(cycle)
                del map_, cycle
        return work

    def collect():
        for _ in range(300):
            gc.collect()
    together(make(0), make(1), make(2), collect, collect)


def weights_file(folder):
    from revisit import proto
    file = proto.parse_net(CONVOLVE)
    file.set_weights({'conv': [np.arange(7, dtype=np.float32)], 'fc': [np.arange(9, dtype=np.float32)]})
    opened = proto.WeightsFile.from_bytes(file.to_bytes())
    indices = [i for i, (name, n) in enumerate(opened.layers) if n]

    def work():
        for i in range(200):
            [array] = opened.read(indices[i % len(indices)])
            if not np.array_equal(array, np.arange(len(array), dtype=np.float32)):
                raise Fault('other weights')
    together(*[work] * 6)


def net_file(folder):
    """Writes and reads one NetFile concurrently."""
    from revisit import proto
    file = proto.parse_net(CONVOLVE)

    def work():
        for i in range(100):
            file.set_weights({'fc': [np.full(1 + i % 50, i, np.float32)]})
            proto.WeightsFile.from_bytes(file.to_bytes())
            file.text()
    together(*[work] * 4)


def nets_of_caffe(folder):
    net = caffe_net(folder, SCALE)

    def work():
        mine = type(net)(str(folder / 'net.prototxt'), 1)
        for i in range(40):
            if not np.array_equal(mine.forward(data=np.full((2, 3), i, np.float32))['out'], np.full((2, 3), 2 * i + 1)):
                raise Fault('another answer')
    together(*[work] * 6)


KEPT = (of_run, of_file, of_description, of_entries, of_points, of_prepared, of_curve)
ALONE = (given_goes, changes_meanwhile, gone_during_pass, map_after_fork)
SHARED = (one_run_mixed, one_map, gone_elsewhere, weights_file, net_file, nets_of_caffe, shared_map(True), shared_map(False))


class Lifetimes(FolderTest):
    def check(self, works):
        for i, work in enumerate(works):
            folder = self.folder / str(i)
            folder.mkdir()
            with self.subTest(work.__qualname__):
                self.assertEqual(faults_of([('', functools.partial(work, folder))]), [])

    def test_arrays_outlive_their_owners(self):
        for make in KEPT:
            with self.subTest(make.__name__):
                self.assertEqual(faults_of([('', functools.partial(stays(make), self.folder))]), [])

    def test_arguments_may_go_or_change(self):
        self.check(ALONE)

    def test_objects_are_shared_by_threads(self):
        self.check(SHARED)

    def test_interpreters_end(self):
        script = self.folder / 'end.py'
        for threads in (1, 2):
            for name, what in ENDS.items():
                with self.subTest(name, threads=threads):
                    script.write_text(BEGIN.format(path=[p for p in sys.path if p], threads=threads) + what + '\n')
                    done = subprocess.run([sys.executable, '-W', 'ignore', script], cwd=self.folder, timeout=60, capture_output=True)
                    self.assertEqual((done.returncode, b'terminate called' in done.stderr), (0, False), done.stderr)


if __name__ == '__main__':
    unittest.main()
