"""revisit.poses: a trajectory in three formats and two frames gives the same poses."""

import unittest

import numpy as np

import revisit
from folders import FolderTest, tum_line
from revisit import poses

N = 40


def trajectory():
    """Returns [n][4][4] of a lidar in a world with z up: a circle of 20 m that climbs 6 m, tilted like a road."""
    angle = np.linspace(0, 2 * np.pi, N)
    quaternions = np.stack([0.05 * np.sin(angle), 0.03 * np.cos(angle), np.sin(angle / 2), np.cos(angle / 2)], 1)
    return poses.rigid(np.stack([20 * np.sin(angle), 20 - 20 * np.cos(angle), angle], 1), quaternions)


class Poses(FolderTest):
    def setUp(self):
        super().setUp()
        self.times = 100 + 0.1 * np.arange(N)

    def write(self, form, given):
        file = self.folder / form
        if form == 'kitti':
            lines = [' '.join(map(repr, pose[:3].ravel().tolist())) for pose in given]
        else:
            lines = [tum_line(time, pose) for time, pose in zip(self.times, given)]
        if form == 'euroc':
            rows = [line.split() for line in lines]
            lines = ['#timestamp [ns],p_x,p_y,p_z,q_w,q_x,q_y,q_z,v'] + [
                ','.join([f'{round(float(t) * 1e9)}', x, y, z, qw, qx, qy, qz, '0']) for t, x, y, z, qx, qy, qz, qw in rows]
        file.write_text('\n'.join(lines) + '\n')
        return file

    def test_forms_and_frames_are_one_trajectory(self):
        lidar = trajectory()
        for form in ('kitti', 'tum', 'euroc'):
            for given in (lidar, poses.AXES_OF_CAMERA @ lidar @ poses.AXES_OF_CAMERA.T):
                for told in ('', form):
                    read = poses.read_trajectory(self.write(form, given), told)[1]
                    np.testing.assert_allclose(read, given, atol=2e-6, err_msg=form)

    def test_of_another_sensor(self):
        T_imu_lidar = poses.rigid(np.array([[0.5, -0.2, 0.3]]), np.array([[0.1, -0.2, 0.7, 0.6]]))[0]
        imu = trajectory() @ np.linalg.inv(T_imu_lidar)
        file = self.folder / 'extrinsic.txt'
        np.savetxt(file, T_imu_lidar[:3])
        read = poses.read_trajectory(self.write('tum', imu))[1] @ poses.read_extrinsic(file)
        np.testing.assert_allclose(read, trajectory(), atol=2e-6)
        calib = self.folder / 'calib.txt'
        calib.write_text('P0: ' + '1 ' * 12 + '\nTr: ' + ' '.join(map(repr, T_imu_lidar[:3].ravel().tolist())) + '\n')
        np.testing.assert_allclose(poses.read_extrinsic(calib), T_imu_lidar)
        file.write_text('1 2 3\n')
        with self.assertRaisesRegex(revisit.InputError, 'found 3'):
            poses.read_extrinsic(file)
        np.savetxt(file, 2 * T_imu_lidar[:3])
        with self.assertRaisesRegex(revisit.InputError, 'not a rotation'):
            poses.read_extrinsic(file)

    def test_variants_of_tum_files(self):
        rows = [line.split() for line in self.write('tum', trajectory()).read_text().splitlines()]
        moved = np.array([448263.1872, 5411942.7731, 213.55])
        variants = {'scientific': [' '.join(f'{float(word):.18e}' for word in row) for row in rows], 'two blanks': ['  '.join(row) for row in rows],
                    'blank at the end': [' '.join(row) + ' ' for row in rows], 'CRLF': [' '.join(row) + '\r' for row in rows],
                    'UTM': [' '.join([row[0], *map(repr, (np.array(row[1:4], float) + moved).tolist()), *row[4:]]) for row in rows]}
        for name, lines in variants.items():
            file = self.folder / name
            file.write_text('\n'.join(lines) + '\n')
            expected = trajectory()
            expected[:, :3, 3] += moved * (name == 'UTM')
            np.testing.assert_allclose(poses.read_trajectory(file)[1], expected, rtol=0, atol=2e-6, err_msg=name)

    def test_order_does_not_matter(self):
        file = self.write('tum', trajectory())
        lines = file.read_text().splitlines()
        file.write_text('# time x y z\n' + '\n'.join(lines[::-1]) + '\n')
        np.testing.assert_allclose(poses.read_trajectory(file)[1], trajectory(), atol=2e-6)

    def test_commas_and_comments_do_not_matter(self):
        for form in ('kitti', 'tum'):
            file = self.write(form, trajectory())
            file.write_text('# poses\n\n' + file.read_text().replace(' ', ', '))
            np.testing.assert_allclose(poses.read_trajectory(file)[1], trajectory(), atol=2e-6, err_msg=form)
        lines = self.write('kitti', trajectory()).read_text().splitlines()
        file.write_text('\n'.join([*lines[:3], '# 3 is lost', *lines[4:]]))
        with self.assertRaisesRegex(revisit.InputError, r':5: expected the pose of frame 3 on the line before'):
            poses.read_trajectory(file)

    def test_nanoseconds_are_recognized_by_their_size(self):
        rows = [line.split() for line in self.write('tum', trajectory()).read_text().splitlines()]
        for start in (0, 1403636579763555584):
            for comma, order, number in ((' ', slice(None), '{}'), (',', [0, 1, 2, 3, 7, 4, 5, 6], '{}'), (',', [0, 1, 2, 3, 7, 4, 5, 6], '{:.18e}')):
                times = [number.format(start + 100_000_000 * i) for i in range(N)]
                file = self.folder / 'ns'
                file.write_text('\n'.join(comma.join(np.array([t, *row[1:]])[order]) for t, row in zip(times, rows)) + '\n')
                times, read = poses.read_trajectory(file)
                np.testing.assert_allclose(np.diff(times), 0.1, atol=1e-6)
                np.testing.assert_allclose(read, trajectory(), atol=2e-6)

    def test_invalid_trajectories_are_rejected(self):
        file = self.folder / 'poses'
        for text, says in (('', 'is empty'), ('1 2 3\n', 'the first line has 3 numbers'),
                           ('1 2 3 4 0 0 0 1\n1 2 x 4 0 0 0 1\n', ':2: expected a finite number, found .x.; begin a header with #, and remove'), ('1 2 3 4 0 0 0 0\n', 'length 0'),
                           ('# x y z\n\n1 2 3 4 0 0 0 1\n1 2 nan 4 0 0 0 1\n', ':4: expected a finite number'),
                           ('num,t,x,y,z,qx,qy,qz,qw\n0,1,2,3,4,0,0,0,1\n', ':1: expected a finite number, found .num.; begin a header'),
                           ('# num\n0,1,2,3,4,0,0,0,1\n', 'the first line has 9 numbers; write the columns of one'),
                           ('# only a comment\n', 'is empty'),
                           ('1,2,3,4,5,6,7,8\n', 'length')):
            file.write_text(text)
            with self.assertRaisesRegex(revisit.InputError, says, msg=text):
                poses.read_trajectory(file)
        with self.assertRaisesRegex(revisit.InputError, 'nowhere'):
            poses.read_trajectory(self.folder / 'nowhere')


if __name__ == '__main__':
    unittest.main()
