"""revisit.maps: adding, recognizing and storing places."""

import os
import threading
import unittest

import numpy as np

import revisit
from folders import FolderTest
from revisit import maps
from scans import room

PLACES = range(12)


def filled(map_):
    """Adds places 0 to 11; ring descriptors warm up with the first 4."""
    for seed in PLACES:
        pose = np.eye(4)
        pose[0, 3] = seed
        map_.add(map_.describe(room(seed)), drive='d', frame=10 * seed, time=seed / 10, pose=pose)
    return map_


class Recognizing(unittest.TestCase):
    def test_finds_a_place_and_the_turn(self):
        map_ = filled(revisit.open_map(warmup=4))
        self.assertEqual(len(map_), len(PLACES))
        loop = map_.query(map_.describe(room(7, turn=0.5)))
        self.assertEqual((loop.index, loop.frame, loop.drive), (7, 70, 'd'))
        self.assertAlmostEqual(loop.relative_yaw, 0.5, delta=0.05)
        self.assertAlmostEqual(loop.time, 0.7)
        self.assertEqual(loop.pose[0, 3], 7)
        other = map_.query(map_.describe(room(7)), exclude=[99, 7, -1])
        self.assertNotEqual(other.index, 7)
        self.assertLess(other.score, loop.score)

    def test_points_of_a_place_register_later_scans(self):
        for seen, rejection in ((room(7), ''), (None, 'no points')):
            map_ = filled(revisit.open_map(warmup=4))
            map_.remove([7])
            map_.add(map_.describe(room(7)), drive='d', frame=70, points=seen)
            found = maps.LoopDetector(map_, drive='later').take(room(7, turn=0.5), frame=0)
            self.assertEqual((found.loop.index, found.rejection), (len(PLACES), rejection))
            if seen is not None:
                self.assertTrue(found.accepted)
                R = found.registered.T_place_query[:2, :2]
                self.assertAlmostEqual(np.arctan2(R[1, 0], R[0, 0]), 0.5, delta=0.01)

    def test_values_that_cannot_be_are_refused(self):
        model = revisit.recognition.shipped_ring_model('hdl64')
        for wrong in ({'dim': 0}, {'candidates': -1}, {'blend': 2}, {'threads': 0}):
            with self.assertRaises(revisit.UsageError, msg=str(wrong)):
                revisit.recognition.ring_recognizer(model, **wrong)
        for wrong in ({'k': 0}, {'score': 'best'}, {'align': 'case3'}, {'sensor': 'hdl63'}):
            for extractor in (revisit.recognition.m2dp_features(), None)['sensor' in wrong:]:
                with self.assertRaises(revisit.UsageError, msg=str(wrong)):
                    maps.Map(extractor=extractor, **wrong)
        for wrong in ({'threshold': float('nan')}, {'target_precision': 1}, {'keyframes': 'some'}, {'exclusion': 'few'}):
            with self.assertRaises(revisit.UsageError, msg=str(wrong)):
                maps.LoopDetector(**wrong)
        with self.assertRaises(TypeError):
            maps.LoopDetector(5)

    def test_the_first_scan_tells_the_sensor(self):
        map_ = revisit.open_map(None)
        self.assertEqual((map_.sensor, map_.warnings), ('', []))
        map_.describe(room(1))
        self.assertRegex(map_.warnings[0], f'^sensor: {map_.sensor} [(].')
        self.assertEqual(map_.sensor, revisit.recognition.choose_ring_model([room(1)])[0])
        self.assertEqual([revisit.open_map(None, name).sensor for name in ('vlp16', 'auto')], ['vlp16', ''])

    def test_views_and_frames_that_cannot_be_are_reported(self):
        scan = room(1)
        for given, warning in ((scan + [100, 0, 0, 0], 'in the frame of a map'), (scan, None)):
            map_ = revisit.open_map(None, 'vlp16')
            detector = revisit.LoopDetector(map_)
            detector.take(given, frame=3)
            self.assertEqual(detector.take(given).error, '')  # frame 4
            self.assertEqual([warning in text for text in map_.warnings], [True] if warning else [])
            for frame in (4, 3):
                with self.assertRaisesRegex(revisit.UsageError, f'frame {frame}: expected frames that ascend, .* after 4'):
                    detector.take(scan, frame=frame)
        for sensor in (None, 'vlp16'):
            self.assertIn('millimeters', revisit.LoopDetector(sensor=sensor).take(scan * 1000, frame=0).error)
        with self.assertRaisesRegex(revisit.UsageError, "give it to open_map"):
            revisit.LoopDetector(map_, sensor='vlp16')

    def test_nothing_is_found_in_nothing(self):
        map_ = revisit.open_map()
        self.assertIsNone(map_.query(map_.describe(room(1))))

    def test_a_scan_without_points_says_why(self):
        map_ = revisit.open_map()
        scan = map_.describe(np.zeros((0, 3), np.float32))
        self.assertFalse(scan.described)
        self.assertIn('no points', scan.error)
        self.assertEqual(len(scan.feature), 0)
        self.assertIsNone(map_.query(scan))
        with self.assertRaises(revisit.UsageError):
            map_.add(scan)

    def test_poses_are_checked(self):
        map_ = revisit.open_map()
        scan = map_.describe(room(1))
        with self.assertRaisesRegex(TypeError, 'float64'):
            map_.add(scan, pose=np.eye(4, dtype=np.float32))
        with self.assertRaisesRegex(ValueError, r'\(4, 4\)'):
            map_.add(scan, pose=np.eye(3))
        with self.assertRaisesRegex(ValueError, 'rigid'):
            map_.add(scan, pose=2 * np.eye(4))
        self.assertEqual(len(map_), 0)

    def test_threads_may_share_one(self):
        map_ = filled(revisit.open_map(warmup=4))
        found = {}

        def ask(seed):
            found[seed] = map_.query(map_.describe(room(seed, 0.3))).index

        threads = [threading.Thread(target=ask, args=(seed,)) for seed in PLACES]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        self.assertEqual(found, {seed: seed for seed in PLACES})


class Maps(FolderTest):
    def setUp(self):
        super().setUp()
        self.file = self.folder / 'town.map'

    def test_no_map_is_made_for_a_local_map_that_no_detector_takes(self):
        for meters in (-3, 0.5, 500, float('nan')):
            file = self.folder / 'local.map'
            with self.assertRaisesRegex(revisit.UsageError, 'local map: expected 1 to 200 m'):
                maps.open_map(file, 'vlp16', local_map=meters)
            self.assertFalse(file.exists())

    def test_stay_on_the_disk(self):
        filled(revisit.open_map(self.file, warmup=4))
        again = revisit.open_map(self.file)
        self.assertEqual((len(again), again.warnings), (len(PLACES), []))
        self.assertEqual(again.query(again.describe(room(3))).index, 3)

    def test_are_opened_by_detectors(self):
        for session in ('monday', 'tuesday'):
            detector = None  # closes the map
            detector = revisit.LoopDetector(self.file, drive=session)
            found = [detector.take(room(seed), frame=seed) for seed in PLACES]
            self.assertEqual((detector.drive, detector.map.sensor != ''), (session, True))
        self.assertEqual([(each.loop.drive, each.loop.frame) for each in found], [('monday', seed) for seed in PLACES])
        self.assertTrue(all(each.accepted for each in found))
        for place in (detector, detector.map):
            queried = place.locate(room(3, turn=0.5))[0]
            self.assertIn(queried.rejection, ('', 'ambiguous'))  # two sessions without poses
            self.assertEqual((queried.index, queried.loop.frame, len(detector.map)), (None, 3, 2 * len(PLACES)))
        map_ = detector.map
        del detector, found, queried
        self.assertEqual(len(map_), 2 * len(PLACES))
        self.assertIs(revisit.LoopDetector(map_).map, map_)

    def test_list_their_entries(self):
        map_ = filled(revisit.open_map(self.file, warmup=4))
        del map_
        with maps.MapStore.open(self.file) as store:
            self.assertEqual(store.fingerprint['feature'], 'ring')
            self.assertEqual(len(store), len(PLACES))
            self.assertEqual(store.dtype, 'float32')
            entries = store.entries()
        self.assertEqual([entry.frame for entry in entries], [10 * seed for seed in PLACES])
        self.assertGreater(len(entries[0].descriptor), 100)
        with self.assertRaisesRegex(revisit.UsageError, 'closed'):
            len(store)
        self.assertEqual(maps.check_map(self.file), [])

    def test_names_of_drives_may_be_any_bytes(self):
        name = os.fsdecode(b'Stra\xdfe')
        map_ = revisit.open_map(self.file)
        map_.add(map_.describe(room(3)), drive=name)
        self.assertEqual(map_.query(map_.describe(room(3))).drive, name)
        with maps.MapStore.open(self.file) as store:
            self.assertEqual([entry.drive for entry in store.entries()], [name])

    def test_places_are_removed(self):
        map_ = filled(revisit.open_map(self.file, warmup=4))
        scan = map_.describe(room(7))
        self.assertEqual(map_.query(scan).index, 7)
        self.assertEqual(map_.remove([7, 2]), 2)
        self.assertNotEqual(map_.query(scan).index, 7)
        self.assertEqual(map_.query(map_.describe(room(8))).index, 8)
        with self.assertRaisesRegex(revisit.UsageError, 'index 12'):
            map_.remove([12])
        del map_
        with maps.MapStore.open(self.file) as store:
            with self.assertRaisesRegex(revisit.UsageError, 'for reading'):
                store.remove([1])
            self.assertEqual(store.removed(), [3, 8])
        with maps.MapStore.open(self.file, write=True) as store:
            self.assertEqual(store.remove([entry.id for entry in store.entries() if entry.time < 0.5]), 4)
            self.assertEqual([entry.frame for entry in store.entries()], [50, 60, 80, 90, 100, 110])
            self.assertEqual((len(store), store.removed(2)), (6, [1, 2, 4, 5]))
            with self.assertRaisesRegex(revisit.UsageError, '1 to 12'):
                store.remove([13])
        self.assertEqual(maps.check_map(self.file), [])
        again = revisit.open_map(self.file)
        self.assertEqual(len(again), 6)
        self.assertEqual(again.query(again.describe(room(8))).frame, 80)

    def test_of_another_feature_are_refused(self):
        filled(revisit.open_map(self.file, warmup=4))
        for _ in range(2):  # they are closed again
            with self.assertRaisesRegex(revisit.InputError, "feature: the map has .*, this program 'm2dp'"):
                maps.Map(self.file, extractor=revisit.recognition.m2dp_features())
        with self.assertRaises(revisit.InputError):
            maps.MapStore.open(self.file.with_name('nowhere.map'))
        other = self.file.with_name('m2dp.map')
        filled(maps.Map(other, extractor=revisit.recognition.m2dp_features()))
        self.assertEqual(len(maps.MapStore.open(other)), len(PLACES))
        with self.assertRaisesRegex(revisit.InputError, 'open the map with this feature'):
            revisit.open_map(other)

    def test_are_merged(self):
        filled(revisit.open_map(self.file, warmup=4))
        both = self.file.with_name('both.map')
        with self.assertRaisesRegex(revisit.UsageError, 'given twice'):
            maps.merge_maps([self.file, self.file], both)
        self.assertEqual(maps.merge_maps([self.file], both), (len(PLACES), []))


if __name__ == '__main__':
    unittest.main()
