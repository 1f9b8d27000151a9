"""revisit.engine: nets, plans, runs, arrays and errors."""

import gc
import multiprocessing
import os
import signal
import subprocess
import sys
import threading
import time
import unittest

import numpy as np

import revisit
from nets import CONVOLVE, SCALE, folder_with
from revisit.engine import Net, Precision, Run, profile
from revisit.proto import parse_net


def small_net(**options):
    with folder_with(net=CONVOLVE) as folder:
        return Net.load_with_random_weights(folder / 'net.prototxt', 7, **options)


def scale_run(**options):
    weights = parse_net(SCALE).to_bytes()  # a caffemodel without weights
    return Net.load_from_memory(SCALE, weights).plan(**options).run()


# An atexit function waits for a thread that still has to work.
BLOCKED = """
import atexit, queue, sys, threading
jobs = queue.Queue()
def work():
    while (run := jobs.get()) is not None:
        print('passes', run.forward())
worker = threading.Thread(target=work, daemon=True)
worker.start()
atexit.register(lambda: (jobs.put(run), jobs.put(None), worker.join()))  # registered before revisit, so called after its function
from revisit.engine import Net
run = Net.load_with_random_weights(sys.argv[1], 7, end='conv').plan().run()
"""


# A thread starts to work after shutdown has begun, and is stopped.
BEGINS_AGAIN = """
import sys, threading, time
from revisit.engine import Net
run = Net.load_with_random_weights(sys.argv[1], 7, end='conv', inputs={'data': (1, 3, 600, 600)}).plan().run()
def passes():
    while True:
        run.forward()
threading.Thread(target=passes, daemon=True).start()
time.sleep(0.2)
"""

LONG = """
input: "data" input_dim: 1 input_dim: 3 input_dim: 300 input_dim: 300
layer { name: "conv" type: "Convolution" bottom: "data" top: "conv" convolution_param { num_output: 100 kernel_size: 101 } }
"""
PASSES = """
import atexit, signal, sys, threading, time
from revisit.engine import Net
signal.signal(signal.SIGINT, signal.default_int_handler)  # shells may ignore SIGINT in background jobs
run = Net.load_with_random_weights(sys.argv[1], 7).plan(reference_kernels=True).run()
threading.Thread(target=run.forward, daemon=True).start()
time.sleep(0.2)
atexit.register(lambda: print('ends', flush=True))
"""


class Loading(unittest.TestCase):
    def test_names_and_shapes_of_the_file(self):
        net = small_net()
        self.assertEqual(net.name, 'small')
        self.assertEqual(net.inputs, {'data': (1, 3, 8, 10)})
        self.assertEqual(net.outputs, ['prob'])
        self.assertEqual(net.layer_names, ['data', 'conv', 'relu', 'pool', 'fc', 'prob'])

    def test_cuts_off_and_grafts(self):
        self.assertEqual(small_net(end='conv').outputs, ['conv'])
        self.assertEqual(small_net(end='conv', graft='pool').outputs, ['conv+pool'])

    def test_takes_other_input_shapes(self):
        net = small_net(end='pool', inputs={'data': (2, 3, 16, 12)})
        self.assertEqual(net.inputs, {'data': (2, 3, 16, 12)})
        plan = net.plan({'data': np.zeros((1, 3, 6, 4)).shape})
        self.assertEqual(plan.outputs, {'pool': (1, 4, 3, 2)})

    def test_a_part_is_a_net_of_the_same_weights(self):
        net = small_net()
        part = net.part('relu', 'fc')
        self.assertEqual((part.inputs, part.outputs), ({'conv': (1, 4, 8, 10)}, ['conv', 'pool', 'fc']))
        self.assertEqual(part.weights['fc'][0].ctypes.data, net.weights['fc'][0].ctypes.data)
        image = np.random.default_rng(1).normal(size=(1, 3, 8, 10)).astype(np.float32)
        run = net.plan(keep_all=True).run()
        run.forward({'data': image})
        rest = part.plan(keep_all=True).run()
        del net, part
        rest.forward({'conv': run.layer_output('conv')})
        np.testing.assert_array_equal(rest.output('fc'), run.layer_output('fc'))
        for first, last in (('con', 'fc'), ('conv', 'fcc'), ('fc', 'conv')):
            with self.assertRaises(revisit.UsageError):
                small_net().part(first, last)

    def test_weights_are_views_that_keep_the_net(self):
        net = small_net()
        weights = net.weights
        self.assertEqual(list(weights), ['conv', 'fc'])
        self.assertEqual([w.shape for w in weights['conv']], [(4, 3, 3, 3), (4,)])
        self.assertFalse(weights['conv'][0].flags.writeable)
        again = net.weights['conv'][0]
        self.assertEqual(weights['conv'][0].ctypes.data, again.ctypes.data)  # no copy
        before = again.copy()
        del net
        gc.collect()
        np.testing.assert_array_equal(weights['conv'][0], before)

    def test_the_prototxt_may_have_the_weights(self):
        with folder_with(net='layer { name: "d" type: "Input" top: "d" input_param { shape { dim: 2 dim: 1 } } } '
                             'layer { name: "s" type: "Scale" bottom: "d" top: "s" '
                             'blobs { shape { dim: 1 } data: 3 } }') as folder:
            net = Net.load(folder / 'net.prototxt')
        self.assertEqual(net.weights['s'][0].tolist(), [3])

    def test_no_weights_is_a_usage_error(self):
        with folder_with(net=CONVOLVE) as folder:
            net = Net.load_without_weights(folder / 'net.prototxt')
        self.assertGreater(net.plan().layers[1].macs, 0)
        with self.assertRaisesRegex(revisit.UsageError, 'without weights'):
            net.weights
        with self.assertRaisesRegex(revisit.UsageError, 'weights'):
            net.plan().run()


class Errors(unittest.TestCase):
    def test_are_of_their_kind(self):
        with self.assertRaisesRegex(revisit.InputError, 'nowhere.prototxt.*No such file'):
            Net.load_without_weights('nowhere.prototxt')
        with self.assertRaisesRegex(revisit.UsageError, "did you mean 'conv'"):
            small_net(end='conv1')
        with self.assertRaisesRegex(revisit.InputError, '<prototxt>:1:'):
            Net.load_from_memory('layer { nam: "x" }', b'')
        with self.assertRaisesRegex(revisit.UnsupportedError, 'Nonsense'):
            Net.load_from_memory(SCALE.replace('"Power"', '"Nonsense"'), b'')
        with self.assertRaisesRegex(revisit.UsageError, 'load_without_weights.*load_with_random_weights'):
            with folder_with(net=CONVOLVE) as folder:
                Net.load(folder / 'net.prototxt')
        with self.assertRaisesRegex(revisit.UsageError, 'thread'):
            small_net().plan(threads=0)

    def test_names_may_be_any_bytes(self):
        with self.assertRaisesRegex(revisit.InputError, 'stra\udcdfe.prototxt.*No such file'):
            Net.load_without_weights(os.fsdecode(b'stra\xdfe.prototxt'))
        with folder_with(net='input: "d\\377" input_dim: 1 input_dim: 1 input_dim: 2 input_dim: 3 '
                             'layer { name: "relu" type: "ReLU" bottom: "d\\377" top: "out" }') as folder:
            run = Net.load_with_random_weights(folder / 'net.prototxt', 7).plan().run()
        name = 'd\udcff'
        with self.assertRaisesRegex(TypeError, f'{name}.*found float64'):
            run.set_input(name, np.zeros((1, 1, 2, 3)))
        with self.assertRaisesRegex(ValueError, f'{name}.*found 1x1x2x4'):
            run.forward({name: np.zeros((1, 1, 2, 4), np.float32)})

    def test_have_one_base(self):
        for name in ('UsageError', 'InputError', 'UnsupportedError', 'Interrupted', 'MemoryError'):
            self.assertTrue(issubclass(getattr(revisit, name), revisit.Error), name)
        self.assertTrue(issubclass(revisit.UsageError, ValueError))
        self.assertTrue(issubclass(revisit.MemoryError, MemoryError))

    def test_too_large_a_run_is_refused(self):
        with self.assertRaisesRegex(revisit.InputError, 'limit of a run'):
            small_net().plan(max_run_bytes=1000)

    def test_wrong_arguments_are_type_errors(self):
        for wrong in ({'threads': 'two'}, {'inputs': {'data': 'large'}}, {'keep': 1}):
            with self.assertRaises(TypeError, msg=str(wrong)):
                small_net().plan(**wrong)


class Running(unittest.TestCase):
    def test_computes(self):
        run = scale_run()
        values = np.arange(6, dtype=np.float32).reshape(2, 3)
        run.input('data')[...] = values
        run.forward()
        np.testing.assert_array_equal(run.output('out'), 2 * values + 1)
        run.forward({'data': values.T.copy().T})
        np.testing.assert_array_equal(run.outputs()['out'], 2 * values + 1)

    def test_strides_may_be_any(self):
        run = scale_run()
        packed = np.zeros(2, [('values', 'f4', 3), ('flag', 'u1')])['values']  # stride of 13 bytes
        packed[...] = np.arange(6).reshape(2, 3)
        run.forward({'data': packed})
        np.testing.assert_array_equal(run.output('out'), 2 * packed + 1)

    def test_outputs_are_read_only_views(self):
        run = scale_run()
        out = run.output('out')
        run.forward({'data': np.ones((2, 3), np.float32)})
        self.assertEqual(out[1, 2], 3)  # the run's own memory
        with self.assertRaises(ValueError):
            out[0, 0] = 1
        self.assertTrue(run.input('data').flags.writeable)

    def test_views_keep_the_run(self):
        run = scale_run()
        run.forward({'data': np.ones((2, 3), np.float32)})
        out, data = run.output('out'), run.input('data')
        del run
        gc.collect()
        junk = [np.zeros(6, np.float32) for _ in range(1000)]
        data[...] = 5
        self.assertTrue((out == 3).all())
        del junk

    def test_layers_are_kept_when_asked(self):
        net = small_net()
        image = np.random.default_rng(1).standard_normal((1, 3, 8, 10), np.float32)
        run = net.plan(keep=['conv']).run()
        run.forward({'data': image})
        self.assertEqual(run.layer_output('conv').shape, (1, 4, 8, 10))
        self.assertLess(run.layer_output('conv').min(), 0)  # before the ReLU in place
        with self.assertRaisesRegex(revisit.UsageError, 'pool'):
            run.layer_output('pool')
        everything = Run(net.plan(keep_all=True))
        everything.forward({'data': image})
        self.assertGreaterEqual(everything.layer_output('relu').min(), 0)

    def test_equals_numpy(self):
        net = small_net(end='fc')
        run = net.plan(keep=['pool']).run()
        run.forward({'data': np.random.default_rng(2).standard_normal((1, 3, 8, 10), np.float32)})
        weights, bias = net.weights['fc']
        expected = weights @ run.layer_output('pool').ravel() + bias
        np.testing.assert_allclose(run.output('fc')[0], expected, rtol=1e-5, atol=1e-6)

    def test_accuracy_and_reference_agree(self):
        image = np.random.default_rng(3).standard_normal((1, 3, 8, 10), np.float32)
        results = []
        for options in ({}, {'strict_accuracy': True}, {'reference_kernels': True}, {'threads': 2}):
            run = small_net().plan(**options).run()
            run.forward({'data': image})
            results.append(run.output('prob').copy())
        for result in results[1:]:
            np.testing.assert_allclose(result, results[0], rtol=1e-5)
        np.testing.assert_array_equal(results[3], results[0])

    def test_bf16_is_close(self):
        image = np.random.default_rng(3).standard_normal((1, 3, 8, 10), np.float32)
        results = []
        for options in ({}, {'precision': Precision.BF16}, {'bf16_weights': True}):
            run = small_net().plan(**options).run()
            run.forward({'data': image})
            results.append(run.output('prob').copy())
        for result in results[1:]:
            self.assertFalse(np.array_equal(result, results[0]))
            np.testing.assert_allclose(result, results[0], rtol=0.05)

    def test_nothing_is_converted(self):
        run = scale_run()
        with self.assertRaisesRegex(TypeError, "input 'data'.*float32, found float64 array of shape \\(2, 3\\)"):
            run.forward({'data': np.ones((2, 3))})
        with self.assertRaisesRegex(TypeError, 'inputs: expected a name, found int'):
            run.forward({1: np.ones((2, 3), np.float32)})
        with self.assertRaisesRegex(TypeError, 'found list'):
            run.forward({'data': [[1, 2, 3], [4, 5, 6]]})
        with self.assertRaisesRegex(TypeError, '>f4'):
            run.forward({'data': np.ones((2, 3), '>f4')})
        with self.assertRaisesRegex(ValueError, 'expected an array of shape 2x3, found 3x2'):
            run.set_input('data', np.ones((3, 2), np.float32))
        with self.assertRaisesRegex(ValueError, 'found 1x3'):  # no broadcasting
            run.set_input('data', np.ones((1, 3), np.float32))
        with self.assertRaisesRegex(revisit.UsageError, 'images'):
            run.set_input('images', np.ones((2, 3), np.float32))


class Threads(unittest.TestCase):
    def test_one_run_in_two_threads_is_refused(self):
        run = small_net(inputs={'data': (1, 3, 8, 10)}).plan(keep=['conv']).run()
        image = np.zeros((1, 3, 8, 10), np.float32)
        calls = {'forward': run.forward, 'set_input': lambda: run.set_input('data', image), 'output': lambda: run.output('prob'),
                 'outputs': run.outputs, 'layer_output': lambda: run.layer_output('conv')}
        busy = threading.Thread(target=lambda: profile(run, repeat=20000))
        busy.start()
        refused = {}
        while busy.is_alive() and len(refused) < len(calls):
            for name, call in calls.items():
                try:
                    call()
                except revisit.UsageError as error:
                    refused[name] = str(error)
        busy.join()
        self.assertEqual(refused.keys(), calls.keys())
        for said in refused.values():
            self.assertIn('Run: another thread is using it', said)

    def test_a_program_ends_while_threads_wait(self):
        with folder_with(net=CONVOLVE) as folder:
            done = subprocess.run([sys.executable, '-W', 'ignore', '-c', BLOCKED, folder / 'net.prototxt'],
                                  text=True, capture_output=True, timeout=60)
        self.assertEqual((done.returncode, done.stdout, done.stderr), (0, 'passes None\n', ''))

    def test_a_program_ends_where_the_interpreter_stops_its_threads(self):
        library = os.environ.get('REVISIT_THREADS_STOP')
        if not library:
            self.skipTest('REVISIT_THREADS_STOP names no library: this build has none')
        preload = ':'.join(filter(None, [os.environ.get('LD_PRELOAD'), library]))
        with folder_with(net=CONVOLVE) as folder:
            done = subprocess.run([sys.executable, '-c', BEGINS_AGAIN, folder / 'net.prototxt'], text=True, capture_output=True,
                                  timeout=60, env={**os.environ, 'LD_PRELOAD': preload})
        self.assertEqual((done.returncode, done.stdout, done.stderr), (0, '', ''))

    def test_ctrl_c_ends_the_wait_for_threads(self):
        with (folder_with(net=LONG) as folder,
              subprocess.Popen([sys.executable, '-c', PASSES, folder / 'net.prototxt'], text=True, stdout=subprocess.PIPE,
                               stderr=subprocess.PIPE) as ends):
            try:
                self.assertEqual(ends.stdout.readline(), 'ends\n')
                with self.assertRaises(subprocess.TimeoutExpired):
                    ends.wait(0.5)
                ends.send_signal(signal.SIGINT)
                self.assertEqual((ends.wait(30), ends.stderr.read()), (-signal.SIGINT, ''))
            finally:
                ends.kill()

    def test_the_interpreter_is_free_meanwhile(self):
        run = small_net(end='conv', inputs={'data': (1, 3, 1000, 1000)}).plan().run()
        done = []
        passes = threading.Thread(target=lambda: [run.forward() for _ in range(20)] and done.append(1))
        ticks = 0
        passes.start()
        while not done and passes.is_alive():
            ticks += 1
            time.sleep(0.0005)
        passes.join()
        self.assertGreater(ticks, 5)

    def test_runs_of_one_plan_agree(self):
        plan = small_net().plan()
        image = np.random.default_rng(4).standard_normal((1, 3, 8, 10), np.float32)
        results = [None] * 4

        def work(i):
            run = plan.run()
            for _ in range(50):
                run.forward({'data': image})
            results[i] = run.output('prob').copy()

        threads = [threading.Thread(target=work, args=(i,)) for i in range(4)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        for result in results[1:]:
            np.testing.assert_array_equal(result, results[0])


    def test_a_forked_process_passes_on_threads_of_its_own(self):
        run = small_net(end='conv', inputs={'data': (1, 3, 300, 300)}).plan(threads=2).run()
        image = np.random.default_rng(4).standard_normal((1, 3, 300, 300), np.float32)
        run.forward({'data': image})
        before = run.output('conv').copy()

        def work():
            run.forward({'data': image})
            sys.exit(not np.array_equal(run.output('conv'), before))

        child = multiprocessing.get_context('fork').Process(target=work)
        child.start()
        child.join(10)
        child.kill()  # if it hangs
        child.join()
        self.assertEqual(child.exitcode, 0)


class Costs(unittest.TestCase):
    def test_plan_lists_layers(self):
        plan = small_net().plan()
        conv = plan.layers[1]
        self.assertEqual((conv.name, conv.type), ('conv', 'Convolution'))
        self.assertEqual(conv.macs, 8 * 10 * 4 * 3 * 9)
        self.assertEqual(conv.parameters, 4 * 3 * 9 + 4)
        self.assertEqual(conv.inputs, [(1, 3, 8, 10)])
        self.assertEqual((conv.field_h.size, conv.field_h.stride, conv.field_h.start), (3, 1, -1))
        self.assertIsNone(plan.layers[4].field_h)
        self.assertGreater(plan.arena_bytes, 0)
        self.assertEqual(plan.weight_bytes, 4 * (108 + 4 + 5 * 4 * 4 * 5 + 5))

    def test_profile_times_each_layer(self):
        run = small_net().plan().run()
        times = profile(run, warmup=1, repeat=5)
        self.assertEqual(times.passes, 5)
        self.assertEqual(len(times.layers), len(run.plan.layers))
        self.assertGreater(times.total.median, 0)
        self.assertLessEqual(times.total.min, times.total.median)


if __name__ == '__main__':
    unittest.main()
