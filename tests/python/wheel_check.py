"""Tests the wheel in an environment with only numpy: it works, and is self-contained."""

import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

import revisit
import revisit.caffe
from revisit import datasets, evaluation, maps, program, proto, recognition, registration
from revisit.engine import Net

sys.path.insert(0, str(Path(__file__).parent))
from wheel_check_common import stands_alone  # noqa: E402

NET = """
layer { name: "data" type: "Input" top: "data" input_param { shape { dim: 1 dim: 1 dim: 4 dim: 4 } } }
layer { name: "fc" type: "InnerProduct" bottom: "data" top: "fc" inner_product_param { num_output: 3 } }
layer { name: "prob" type: "Softmax" bottom: "fc" top: "prob" }
"""


def classifies():
    net = proto.parse_net(NET)
    weights = np.zeros((3, 16), np.float32)
    weights[1] = 1
    net.set_weights({'fc': [weights, np.zeros(3, np.float32)]})
    run = Net.load_from_memory(NET, net.to_bytes()).plan(threads=2).run()
    run.forward({'data': np.ones((1, 1, 4, 4), np.float32)})
    assert run.output('prob').argmax() == 1, run.output('prob')


def finds_a_loop():
    detector = revisit.LoopDetector(revisit.open_map(warmup=10), exclusion='frames=8', verify=False, threshold=0.3)
    with tempfile.TemporaryDirectory() as folder:
        program.run('simulate', '-o', folder, '--length', 400, '--every', 30)
        drive = datasets.open_dataset(folder, poses=True).scans
        loops = []
        for i, ref in enumerate(drive):
            found = detector.take(datasets.read_scan(ref.file), frame=i)
            if found.accepted:
                apart = ref.pose[:3, 3] - drive[found.loop.frame].pose[:3, 3]
                loops.append(np.linalg.norm(apart[[0, 2]]))
    assert loops, f'no loop in {len(drive)} scans'
    assert np.median(loops) < 10, loops
    print(f'{len(loops)} loops in {len(drive)} scans, {np.median(loops):.1f} m apart')


def has_the_commands():
    with tempfile.TemporaryDirectory() as folder:
        np.save(f'{folder}/0.npy', np.random.default_rng(1).uniform(-20, 20, (5000, 3)).astype(np.float32))
        done = subprocess.run([Path(sys.executable).with_name('revisit-loops'), folder, '--all'], text=True, capture_output=True)
    assert done.returncode == 0 and done.stdout.startswith('frame,time,'), done.stdout + done.stderr
    done = subprocess.run([Path(sys.executable).with_name('revisit-convert'), '--help'], text=True, capture_output=True)
    assert done.returncode == 0 and 'onnx' in done.stdout, done.stdout + done.stderr


def evaluates():
    judged = evaluation.labels([4, 3, 2, 1], np.array([True, False, True, False]), np.array([True, True, True, False]))
    figures = evaluation.summarize(judged)
    assert np.allclose([figures.average_precision, figures.recall_at_1], [(1 + 2 / 3) / 3, 2 / 3]), figures.average_precision
    line = np.outer(np.arange(5), np.ones(3)).astype(np.float32)
    assert recognition.fit_pca(line, 2).rank == 1


def registers():
    with tempfile.TemporaryDirectory() as folder:
        program.run('simulate', '-o', folder, '--length', 300, '--every', 200)
        place = datasets.read_scan(datasets.open_dataset(folder).scans[0].file)
    query = place.copy()
    query[:, 0] -= 1
    found = registration.register_scans(query, place, 0)
    assert found.fits and np.allclose(found.T_place_query[:3, 3], [1, 0, 0], atol=0.05), found.T_place_query


def has_the_program():
    command = Path(sys.executable).with_name('revisit')
    done = subprocess.run([command, '--version'], text=True, capture_output=True)
    assert done.returncode == 0 and revisit.__version__ in done.stdout, done.stdout + done.stderr
    with tempfile.TemporaryDirectory() as folder:
        program.run('simulate', '-o', f'{folder}/town', '--length', 300, '--every', 100)
        done = subprocess.run([command, 'loops', f'{folder}/town', '--map', f'{folder}/town.map', '-q'], text=True, capture_output=True)
        assert done.returncode == 0 and done.stdout.startswith('frame,time,'), done.stdout + done.stderr
        places = len(maps.MapStore.open(f'{folder}/town.map'))
        assert f' {places} entries' in program.run('map', 'remove', f'{folder}/town.map', '--ids', 1).stdout
        program.run('loops', f'{folder}/town', '--all', '-q', '--format', 'jsonl', '-o', f'{folder}/loops.jsonl')
        program.run('report', f'{folder}/loops.jsonl', '-o', f'{folder}/report.html')
        assert 'loops.jsonl' in Path(f'{folder}/report.html').read_text()
        try:
            program.run('report', f'{folder}/nothing', '-o', f'{folder}/report.html')
            assert False, 'a report of nothing'
        except revisit.InputError as error:
            assert 'nothing' in str(error)


classifies()
finds_a_loop()
evaluates()
registers()
has_the_commands()
has_the_program()
stands_alone()
print(f'revisit {revisit.__version__} with numpy {np.__version__} works')
