"""Every former public name works and warns once; the current names do not warn."""

import importlib
import tempfile
import unittest
import warnings
from pathlib import Path
from unittest import mock

import numpy as np

import revisit
from revisit import _former, datasets, engine, evaluation, loops, maps, recognition, registration, report, simulation
from scans import room

NET = """
layer { name: "data" type: "Input" top: "data" input_param { shape { dim: 1 dim: 1 dim: 4 dim: 4 } } }
layer { name: "conv" type: "Convolution" bottom: "data" top: "conv" convolution_param { num_output: 1 kernel_size: 1 } }
"""
MODULES = {
    'datasets': {'alter': 'perturb'},
    'evaluation': {'Verdict': 'MatchLabel', 'judge': 'label_matches', 'verdicts': 'labels'},
    'loops': {'recognise': 'recognize'},
    'maps': {'maker_of': 'feature_key_of'},
    'recognition': {'misfit_of_view': 'scan_frame_error', 'ring_recogniser': 'ring_recognizer'},
}


def extractor():
    return recognition.scan_context_features()


def net(folder):
    (folder / 'net.prototxt').write_text(NET)
    return engine.Net.load_with_random_weights(folder / 'net.prototxt', 1)


def of(path):
    library, *names = path.split('.')
    found = getattr(revisit._core, library)
    for name in names:
        found = getattr(found, name)
    return found


class FormerNames(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = Path(folder.name)

    def warned(self, expected, call):
        """Checks that call() warns `expected` times, and at this file. Returns its result."""
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter('always')
            result = call()
        self.assertEqual([warning.category for warning in caught], [DeprecationWarning] * expected, [str(w.message) for w in caught])
        self.assertEqual({warning.filename for warning in caught}, {__file__} if expected else set())
        return result

    def keywords(self, path, names, call, values):
        """Checks that call(**values) accepts each former keyword instead of the current one."""
        self.warned(0, lambda: call(**values))
        for former, name in names.items():
            given = {former if key == name else key: value for key, value in values.items()}
            self.assertIn(former, given, path)
            self.warned(1, lambda: call(**given))
            with self.assertRaisesRegex(TypeError, f"multiple values for argument '{name}'"), warnings.catch_warnings():
                warnings.simplefilter('ignore')
                call(**values, **{former: values[name]})

    def test_modules(self):
        for module, names in MODULES.items():
            module = importlib.import_module(f'revisit.{module}')
            for former, name in names.items():
                self.assertIs(self.warned(1, lambda: getattr(module, former)), self.warned(0, lambda: getattr(module, name)))
                self.assertNotIn(former, dir(module))
            with self.assertRaisesRegex(AttributeError, f"module '{module.__name__}' has no attribute 'nonsense'"):
                module.nonsense

    def test_keywords_of_the_extension(self):
        walls = room(1)
        label = evaluation.MatchLabel(1.0, True, True)
        calls = {
            'datasets.perturb': (datasets.perturb, {'points': walls, 'seed': 1, 'perturbation': 'height=1'}),
            'engine.Net.plan': (net(self.folder).plan, {'channel_offsets': None}),
            'evaluation.ListedPairs.__init__': (evaluation.ListedPairs, {'correct': {1: {2}}, 'ignored': {}}),
            'evaluation.bootstrap': (evaluation.bootstrap, {'labels': [label] * 4, 'blocks': 1, 'resamples': 10}),
            'evaluation.precision_recall': (evaluation.precision_recall, {'labels': [label]}),
            'evaluation.summarize': (evaluation.summarize, {'labels': [label]}),
            'maps.Detection.__init__': (maps.Detection, {'error': 'x'}),
            'maps.LoopDetector.__init__': (maps.LoopDetector, {
                'recognizer': maps.PlaceRecognizer(extractor()), 'target_precision': 0.9}),
            'maps.MapStore.open': (maps.MapStore.open, {
                'file': self.folder / 'm.map', 'dtype': 'float16',
                'fingerprint': maps.PlaceRecognizer.fingerprint_of(extractor())}),
            'maps.PlaceRecognizer.__init__': (maps.PlaceRecognizer, {
                'extractor': extractor(), 'warmup': 4, 'target_precision': 0.9}),
            'maps.PlaceRecognizer.query': (maps.PlaceRecognizer(extractor()).query, {
                'scan': maps.PlaceRecognizer(extractor()).describe(walls), 'exclude': [0]}),
            'maps.PlaceRecognizer.remove': (maps.PlaceRecognizer(extractor()).remove, {'indices': []}),
            'recognition.choose_ring_model': (recognition.choose_ring_model, {'scans': [walls], 'feature_key': ''}),
            'recognition.ring_recognizer': (recognition.ring_recognizer, {
                'model': recognition.shipped_ring_model('hdl64'), 'dim': 256, 'regularization': 0.01, 'blend': 0.3,
                'candidates': 10}),
            'registration.RegistrationOptions.__init__': (registration.RegistrationOptions, {
                'voxel_size': 0.4, 'search_radius': 6, 'min_inlier_ratio': 0.4, 'min_constraint': 0.02}),
            'registration.register_scans': (registration.register_scans, {'query': walls, 'place': walls, 'relative_yaw': 0.0}),
        }
        self.assertEqual(set(calls), set(_former.KEYWORDS))
        for path, (call, values) in calls.items():
            self.keywords(path, _former.KEYWORDS[path], call, values)

    def test_keywords_mean_the_same(self):
        options = registration.RegistrationOptions
        with warnings.catch_warnings():
            warnings.simplefilter('ignore')
            self.assertEqual(options(voxel=0.3, reach=5, max_range=50).search_radius, 5)
            self.assertEqual(evaluation.ListedPairs(right={1: {2}}).correct, {1: {2}})
            self.assertEqual(maps.Detection(why_not='x').error, 'x')
            self.assertEqual(maps.open_map(first_stretch=4, precision=0.9).threshold, maps.open_map(target_precision=0.9).threshold)
        with self.assertRaisesRegex(TypeError, 'incompatible function arguments'):
            options(voxels=1)

    def test_keywords_of_python(self):
        with mock.patch.object(report.program, 'run') as run:
            self.keywords('write_report', {'page': 'output'}, report.write_report, {'runs': 'x', 'output': 'y'})
        self.assertEqual({call.args for call in run.call_args_list}, {('report', 'x', '-o', 'y')})
        self.keywords('open_map', {'first_stretch': 'warmup', 'precision': 'target_precision'}, revisit.open_map,
                      {'warmup': 4, 'target_precision': 0.9})
        self.assertEqual(revisit.open_map.__name__, 'open_map')

    def objects(self):
        recognizer = maps.PlaceRecognizer(extractor(), threshold=0)
        scan = recognizer.describe(room(1))
        recognizer.add(scan)
        trajectory = evaluation.Trajectory(range(200), np.array([[i, 0.0, 0] for i in range(200)]))
        task = evaluation.make_tasks('online', '', trajectory)[0]
        town = self.folder / 'town'
        return {
            'engine.LayerCost': net(self.folder).plan().layers[1],
            'engine.Net': net(self.folder),
            'evaluation.ListedPairs': evaluation.ListedPairs({1: {2}}),
            'evaluation.Task': task,
            'maps.Description': scan,
            'maps.Detection': maps.LoopDetector(recognizer).take(room(2), frame=0),
            'maps.Loop': recognizer.query(scan),
            'maps.LoopSummary': maps.LoopSummary('none', None),
            'maps.MapStore': maps.MapStore.open(self.folder / 'm.map', maps.PlaceRecognizer.fingerprint_of(extractor())),
            'maps.PlaceRecognizer': recognizer,
            'recognition.RingModel': recognition.shipped_ring_model('hdl64'),
            'registration.Registration': registration.register_scans(room(1), room(1), 0),
            'registration.RegistrationOptions': registration.RegistrationOptions(),
            'simulation.SimulationSummary': simulation.simulate(town, sensor='vlp16', length=300, last_frame=0),
        }

    def test_attributes(self):
        objects = self.objects()
        self.assertEqual(set(objects), set(_former.ATTRIBUTES))
        for path, names in _former.ATTRIBUTES.items():
            for former, name in names.items():
                value, current = self.warned(1, lambda: getattr(objects[path], former)), self.warned(
                    0, lambda: getattr(objects[path], name))
                if not callable(current):
                    self.assertEqual(value, current, (path, former))
                self.assertNotIn(former, dir(objects[path]))
            with self.assertRaisesRegex(AttributeError, "object has no attribute 'nonsense'"):
                objects[path].nonsense
        visit = loops.Visit(None, objects['maps.Detection'], None)
        self.assertEqual(self.warned(1, lambda: visit.position), visit.index)
        self.assertEqual(self.warned(1, lambda: visit.why_not), visit.error)
        result = evaluation.Evaluation(None, None, None, {}, [], [1])
        self.assertEqual(self.warned(1, lambda: result.verdicts), result.labels)

    def test_attributes_of_classes(self):
        for path, names in _former.OF_CLASSES.items():
            for former, name in names.items():
                value = self.warned(1, lambda: getattr(of(path), former))
                self.assertEqual(value, self.warned(0, lambda: getattr(of(path), name)))
        self.assertEqual([member.name for member in engine.Accuracy], ['DEFAULT', 'STRICT'])


if __name__ == '__main__':
    unittest.main()
