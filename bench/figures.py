#!/usr/bin/env python3
"""Draws the pictures of README.md and docs/ into docs/figures/.

  bench/figures.py                       all charts, from docs/data/
  bench/figures.py --revisit PROGRAM     also the pictures, which `revisit` makes of the drives in REAL and of simulated ones
  bench/figures.py speed_engines steps   only these

REAL is ../shared/real, or the option --real. Scans stay there: docs/figures/ gets pictures only. Needs numpy and matplotlib. Backgrounds are transparent,
and colors have a contrast of 3 or more to white and to black. bench/screenshots.sh makes the other pictures.
"""

import argparse
import csv
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import matplotlib
import numpy as np

matplotlib.use('Agg')
import matplotlib.pyplot as plt  # noqa: E402

sys.path.insert(0, str(Path(__file__).resolve().parent))
import tables  # noqa: E402
from loop_lines import lines_of, pose_of, run  # noqa: E402

ROOT = Path(__file__).resolve().parents[1]
FIGURES = ROOT / 'docs/figures'
RING, CONTEXT, TRAINED, PAPER, CLOSURES, GRAY, INK, GRID = '#3b82f6', '#ea580c', '#b8860b', '#16a34a', '#a855f7', '#8b949e', '#77808c', '#88888840'
METHODS = {'rings': RING, 'Scan Context, all candidates': CONTEXT, 'Scan Context, learnt as rings': TRAINED,
           "the paper's feature, best variant": PAPER, 'MapClosures, local maps of 20 m': CLOSURES}
CHARTS, PICTURES = {}, {}

plt.rcParams.update({'font.size': 9, 'font.family': 'DejaVu Sans', 'axes.spines.top': False, 'axes.spines.right': False, 'axes.titlesize': 10,
                     'axes.titlelocation': 'left', 'savefig.transparent': True, 'legend.frameon': False, 'figure.constrained_layout.use': True,
                     'axes.edgecolor': INK, 'text.color': INK, 'axes.labelcolor': INK, 'xtick.color': INK, 'ytick.color': INK, 'grid.color': GRID,
                     'axes.axisbelow': True, 'svg.hashsalt': 'revisit'})


def register(functions):
    return lambda function: functions.setdefault(function.__name__, function)


chart, picture = register(CHARTS), register(PICTURES)


def rows_of(file):
    with (tables.DATA / file).open(newline='') as lines:
        return list(csv.DictReader(lines))


def save(figure, name, suffix='svg', **options):
    file = FIGURES / f'{name}.{suffix}'
    figure.savefig(file, metadata={'Date': None} if suffix == 'svg' else None, **options)
    plt.close(figure)
    print(f'{file.relative_to(ROOT)}: {file.stat().st_size / 1000:.0f} kB')
    if file.stat().st_size > 200_000:
        raise SystemExit(f'figures: {file} is larger than 200 kB')


def rows_on(axes, labels):
    axes.set_yticks(range(len(labels)), labels)
    axes.set_ylim(len(labels) - 0.45, -0.55)
    axes.tick_params(axis='y', length=0)


def bars(axes, labels, series, form, unit):
    """series: name -> (color, a value or None for each label)."""
    height = 0.8 / len(series)
    for k, (name, (color, values)) in enumerate(series.items()):
        at = np.arange(len(labels)) + (k - (len(series) - 1) / 2) * height
        axes.barh(at, [value or 0 for value in values], height * 0.9, color=color, label=name)
        for y, value in zip(at, values):
            axes.text(value or 0, y, ' ' + ('not run' if value is None else form.format(value)), va='center', fontsize=7)
    axes.set_xlabel(unit)
    rows_on(axes, labels)


@chart
def results_real():
    """How well are places recognized on real drives?"""
    (figure, axes), rows, drives = plt.subplots(figsize=(7.2, 4.2)), tables.rows_of('real_drives.json'), tables.DRIVES
    for k, (method, color) in enumerate(METHODS.items()):
        label = 'ring descriptor (revisit)' if method == 'rings' else tables.shown(method)
        for i, drive in enumerate(drives):
            places = next(row['with_place'] for row in rows if (row['drive'], row['name']) == (drive, 'rings'))  # of the same protocol
            names = tables.BRIEF.get(method, (method,))
            found = [row for row in rows if (row['drive'], row['with_place']) == (drive, places) and row['name'] in names]
            if found:
                row, y = max(found, key=lambda row: row['ap']), i + (k - 2) * 0.15
                axes.hlines(y, *row.get('ap_interval', (row['ap'],) * 2), color=color, linewidth=2.2, alpha=0.55)
                axes.plot(row['ap'], y, 'o', color=color, markersize=5, label=label)
                label = None
    axes.set(xlim=(-0.02, 1.02), title='Real drives', xlabel='average precision (AP); lines: 95 % intervals, where they were computed')
    axes.grid(axis='x')
    rows_on(axes, [title.replace(', ', '\n') for title in drives.values()])
    figure.legend(loc='outside lower center', ncols=3, fontsize=8)
    save(figure, 'results_real')


@chart
def results_perturbed():
    """How robust are descriptors to perturbed scans?"""
    rows = tables.rows_of('perturbed_scans.json')
    drives, steps = ('nclt', 'riverside'), list(dict.fromkeys(row['perturbation'] for row in rows))
    figure, all_axes = plt.subplots(1, 2, figsize=(8.6, 5.2), sharey=True)
    for axes, drive in zip(all_axes, drives):
        value = {(row['name'], row['perturbation']): row['recall_at_1'] for row in rows if row['drive'] == drive}
        pairs = [[value.get((method, step), np.nan) for step in steps] for method in ('rings', 'Scan Context')]
        axes.hlines(range(len(steps)), *pairs, color=GRAY, linewidth=1)
        axes.scatter(pairs[0], range(len(steps)), color=RING, s=26, zorder=3, label='ring descriptor (revisit)')
        axes.scatter(pairs[1], range(len(steps)), color=CONTEXT, s=26, marker='s', zorder=3, label='Scan Context')
        axes.set(xlim=(-0.02, 1.02), xlabel='recall@1', title=tables.DRIVES[drive])
        axes.grid(axis='x')
    rows_on(all_axes[0], [step.replace('+pitch=3+sector=50+sector=50', '+pitch=3\n+sector=50 twice') for step in steps])
    figure.legend(*axes.get_legend_handles_labels(), loc='outside lower center', ncols=2)
    save(figure, 'results_perturbed')


def times_as_long(name, machine, **engines):
    """engines: first words of a column -> (title, color)."""
    rows = [row for row in rows_of(f'{name}.csv') if row['machine'] == machine and row['threads'] == '1']
    labels = [f'{row["net"]}\n{row["input"]}: {float(row["revisit_min_ms"]):.1f} ms' for row in rows]
    series = {title: (color, [float(row[f'{engine}_times_as_long_min']) for row in rows]) for engine, (title, color) in engines.items()}
    figure, axes = plt.subplots(figsize=(7.2, 0.62 * len(rows) + 1.5))
    bars(axes, labels, {'revisit': (RING, [1] * len(rows))} | series, '{:.2f}', 'times as long as revisit, float32; fastest pass, one thread')
    axes.set_title(machine)
    axes.margins(x=0.08)
    figure.legend(loc='outside lower center', ncols=4, fontsize=8)
    save(figure, name)


@chart
def speed_engines():
    """How fast is a network, compared with oneDNN, Caffe's algorithm and OpenCV?"""
    times_as_long('speed_engines', 'Intel Sapphire Rapids', onednn=('oneDNN 2.6 (2022)', TRAINED), im2col_openblas=('im2col + OpenBLAS, as Caffe', CONTEXT),
                  opencv_dnn=('OpenCV dnn 4.6 (2022)', GRAY))


@chart
def speed_peers():
    """How fast compared with ONNX Runtime and OpenVINO?"""
    times_as_long('speed_peers', 'AMD EPYC (Zen 3)', onnxruntime=('ONNX Runtime 1.32', CONTEXT), openvino=('OpenVINO 2026.4', TRAINED))


@chart
def speed_bf16():
    """What does bfloat16 gain?"""
    rows = [row for row in rows_of('speed_peers.csv') if row['threads'] == '1']
    figure, all_axes = plt.subplots(1, 2, figsize=(8.6, 4.4), sharey=True)
    for axes, machine in zip(all_axes, dict.fromkeys(row['machine'] for row in rows)):
        chosen = [row for row in rows if row['machine'] == machine]
        series = {name: (color, [float(row['revisit_min_ms']) / float(row[column]) for row in chosen])
                  for name, column, color in (('revisit', 'revisit_bf16_min_ms', RING), ('OpenVINO', 'openvino_bf16_min_ms', TRAINED))}
        bars(axes, [f'{row["net"]}, {row["input"]}' for row in chosen], series, '{:.2f}', 'bf16: times as fast as revisit in float32')
        axes.set_title(machine)
        axes.margins(x=0.12)
    figure.legend(*axes.get_legend_handles_labels(), loc='outside lower center', ncols=2)
    save(figure, 'speed_bf16')


@chart
def speed_sizes():
    """How does time grow with the image, and what do threads gain?"""
    figure, (left, right) = plt.subplots(1, 2, figsize=(8.6, 3.6))
    columns, colors = (1000, 2000, 4000, 8000, 16000), {'AlexNet': RING, 'VGG-CNN-S': CONTEXT, 'Places-CNDS-8': PAPER}
    for row in rows_of('speed_sizes.csv'):
        color, one = colors[row['net']], row['threads'] == '1'
        left.loglog(columns, [float(row[f'columns_{n}_ms']) for n in columns], '-o' if one else '--s', color=color, markersize=4,
                    markerfacecolor=color if one else 'none', label=f'{row["net"]}, {"1 thread" if one else "2 threads"}')
    left.set(xlabel='columns of a range image', ylabel='ms', title='Time by width (Intel Sapphire Rapids)')
    left.set_xticks(columns, map(str, columns))
    left.minorticks_off()
    left.legend(fontsize=7, handlelength=4)
    rows, counts = sorted(rows_of('speed_threads.csv'), key=lambda row: float(row['speedup_16_threads'])), (1, 2, 8, 16)
    for row in rows:
        ends = row in (rows[0], rows[-1])
        right.plot(counts, [1, *(float(row[f'speedup_{n}_threads']) for n in counts[1:])], color=RING if ends else GRAY, linewidth=1 + ends)
        right.text(16, float(row['speedup_16_threads']), ' ' + row['net'].split()[0] if ends else '', va='center', fontsize=8)
    right.plot((1, 16), (1, 16), color=INK, linewidth=0.8, linestyle=':')
    right.set(xlabel='threads', ylabel='times as fast as one thread', xlim=(0, 21), title='Predicted, not measured beyond 2 threads (Zen 4)')
    right.set_xticks(counts)
    save(figure, 'speed_sizes')


@chart
def speed_maps():
    """How long does a query take in a large map?"""
    figure, axes = plt.subplots(figsize=(6.8, 3.6))
    rings = [row for row in rows_of('speed_ring_maps.csv') if row['candidates'] == '1000']
    cosines = [row for row in rows_of('speed_large_maps.csv') if row['search'] == 'exact' and row['similarity'] == 'cosines']
    for rows, column, style, color, label in ((rings, 'all_yaw_angles_median_ms', '--s', CONTEXT, 'ring descriptor, every map entry at all yaw angles'),
                                              (rings, 'with_codes_median_ms', '-o', RING, 'ring descriptor, 1000 candidates by compact codes (default)'),
                                              (cosines, 'p50_ms', ':^', PAPER, 'cosines of 400 dimensions, exact')):
        axes.loglog([int(row['map_entries']) for row in rows], [float(row[column]) for row in rows], style, color=color, markersize=5, label=label)
    axes.set(xlabel='map entries', ylabel='ms per query, one thread', title='AMD EPYC')
    axes.grid()
    axes.legend(fontsize=8, handlelength=4)
    save(figure, 'speed_maps')


@chart
def speed_methods():
    """How many scans per second does each method describe?"""
    rows = sorted(rows_of('speed_methods.csv'), key=lambda row: -float(row['frames_per_s']))
    figure, axes = plt.subplots(figsize=(6.8, 3.2))
    bars(axes, [row['method'].split(' (')[0] for row in rows], {'here': (RING, [float(row['frames_per_s']) for row in rows])}, '{:.0f}',
         'scans per second, one thread (log scale)')
    known = [(float(row['frames_per_s_in_paper']), i) for i, row in enumerate(rows) if row['frames_per_s_in_paper']]
    axes.plot(*zip(*known), 'D', color=CONTEXT, markersize=5, label='in the paper, on another machine')
    axes.set(xscale='log', xlim=(1, 1500))
    figure.legend(loc='outside lower center', ncols=2, fontsize=8)
    save(figure, 'speed_methods')


@chart
def accuracy():
    """How far are outputs from the original Caffe's?"""
    figure, (left, right) = plt.subplots(1, 2, figsize=(9, 4.2))
    for axes, file, columns, title in (
            (left, 'accuracy_float32.csv', (('default', 'o', RING, 'default'), ('strict', 's', TRAINED, '--accuracy strict'),
                                            ('without_winograd', '|', INK, 'without Winograd')), 'Engine, reduced nets: largest error of a layer'),
            (right, 'accuracy_onnx.csv', (('from_caffe', 'o', CONTEXT, 'from Caffe'), ('from_engine', 'x', INK, 'from the engine')), 'ONNX models, worst output')):
        rows = rows_of(file)
        for column, marker, color, label in columns:
            axes.semilogx([float(row[column]) for row in rows], range(len(rows)), marker, color=color, label=label, markersize=9 if marker == '|' else 5)
        axes.set(title=title, xlabel='max |a - b| / max |b|')
        rows_on(axes, [row['net'].removeprefix('reduced-width ') + (', reduced' if axes is right and i >= 8 else '') for i, row in enumerate(rows)])
        axes.tick_params(axis='y', labelsize=7)
        axes.grid(axis='x')
        axes.legend(loc='upper center', bbox_to_anchor=(0.5, -0.16), ncols=3, fontsize=7, handletextpad=0.2, columnspacing=0.8)
    save(figure, 'accuracy')


def posed(folder):
    return folder / 'bin', '--poses', folder / 'poses_kitti.txt', '--pose-frame', 'lidar', '--exclusion', 'meters=50'


@picture
def loops(o):
    """The accepted loops of a real drive, whole, and where it comes back."""
    lines = lines_of(*posed(o.real / 'nclt'), '--odometry-gate', 'none')
    at = {line['frame']: (line['position']['x'], line['position']['y']) for line in lines if 'position' in line}
    path = np.array(list(at.values()))
    driven = np.concatenate([[0], np.cumsum(np.hypot(*np.diff(path, axis=0).T))])
    with_place = [frame for frame, here, s in zip(at, path, driven) if (np.hypot(*(path[driven < s - 50] - here).T) < 5).any()]
    accepted = [line for line in lines if line.get('accepted')]
    pairs = np.array([(at[line['frame']], at[line['match_frame']]) for line in accepted])
    wrong = np.hypot(*(pairs[:, 0] - pairs[:, 1]).T) > 10
    missed = np.array([at[frame] for frame in with_place if frame not in {line['frame'] for line in accepted}]).reshape(-1, 2)
    revisited = np.array([at[frame] for frame in with_place])
    middle, low, high = revisited[:, 0].min() / 2 + revisited[:, 0].max() / 2, revisited[:, 1].min() - 8, revisited[:, 1].max() + 8
    figure, panels = plt.subplots(1, 2, figsize=(9, 2.7))
    titles = f'NCLT, HDL-32E: {len(path)} scans, {driven[-1]:.0f} m', 'The part that is driven twice'
    for axes, size, bar, title in zip(panels, (1, 3), (50, 20), titles):
        axes.plot(*path.T, color=GRAY, linewidth=1.5, zorder=1)
        axes.plot(*pairs.transpose(2, 1, 0), color=RING, linewidth=0.6 * size, zorder=2)
        for points, color, marker, area, what in ((pairs[~wrong, 0], RING, 'o', 5, 'accepted loops, within 10 m'),
                                                  (pairs[wrong, 0], '#ef4444', 'o', 12, 'accepted loops, beyond 10 m'),
                                                  (missed, CONTEXT, 'x', 12, 'places within 5 m, not accepted')):
            axes.scatter(*points.T, s=area * size, color=color, marker=marker, zorder=3, label=f'{what}: {len(points)}')
        axes.set(title=title, xticks=[], yticks=[], aspect='equal', **({'xlim': (middle - 70, middle + 70), 'ylim': (low, high)} if size > 1 else {}))
        axes.spines[:].set(visible=True, color=GRID)
        right, bottom = axes.get_xlim()[1], axes.get_ylim()[0]
        axes.plot([right - 1.1 * bar, right - 0.1 * bar], [bottom + bar / 5] * 2, color=INK, linewidth=2)
        axes.text(right - 0.6 * bar, bottom + bar / 4, f'{bar} m', ha='center', va='bottom', fontsize=8)
    panels[0].legend(fontsize=7, loc='lower left')
    save(figure, 'loops')


def curve(order):
    """Recall and precision of rows (score, correct, positive), best first."""
    score, correct, positive = order[np.argsort(-order[:, 0], kind='stable')].T
    return np.cumsum(correct) / max(positive.sum(), 1), np.cumsum(correct) / np.arange(1, len(score) + 1)


@picture
def curves(o):
    """Precision and recall on real drives, with 95 % intervals by blocks of 50 scans."""
    pairs, random, grid = o.real / 'riverside/loops', np.random.default_rng(0), np.linspace(0.01, 1, 100)
    drives = {'NCLT, HDL-32E': (*posed(o.real / 'nclt'), '--negative-radius', 10),
              'MulRan Riverside, OS1-64': (o.real / 'riverside', '--pairs', f'{pairs}.csv,{pairs}_weak.csv,{pairs}_by_time.csv,near=2,'
                                           'bench/riverside/without_place.csv', '--exclusion', 'frames=332'),
              'Walk, Livox Mid-360': (*posed(o.real / 'mid360_walk'), '--negative-radius', 10)}
    figure, panels = plt.subplots(1, 3, figsize=(9, 3.1), sharey=True)
    for axes, (title, words) in zip(panels, drives.items()):
        for feature, color, label in (('ring', RING, 'ring descriptor (revisit)'), ('scan-context', CONTEXT, 'Scan Context')):
            run('eval', *words, '--feature', feature, '--no-report', '--quiet', '-o', o.work / title / feature, stdout=subprocess.PIPE)
            task = json.loads(next((o.work / title / feature).glob('*/latest/run.json')).read_text())['tasks'][0]
            flags = np.array(task['flags'])
            rows = np.stack([task['score'], (flags & 2) > 0, (flags & 4) > 0], 1)[(flags & 8) == 0]
            blocks = np.array_split(rows, max(1, len(rows) // 50))
            drawn = [np.concatenate([blocks[k] for k in random.integers(len(blocks), size=len(blocks))]) for _ in range(500)]
            low, high = np.percentile([np.interp(grid, *curve(each), right=0) for each in drawn if each[:, 2].any()], (2.5, 97.5), axis=0)
            axes.fill_between(grid, low, high, color=color, alpha=0.2, linewidth=0)
            axes.plot(*curve(rows), color=color, label=label)
        axes.set(xlim=(0, 1.01), ylim=(0, 1.03), xlabel='recall', title=title)
        axes.grid()
    panels[0].set_ylabel('precision')
    figure.legend(*axes.get_legend_handles_labels(), loc='outside lower center', ncols=2)
    save(figure, 'curves')


@picture
def steps(o):
    """From a scan to an edge: the data of each step, of a simulated drive."""
    data = o.work / 'town'
    run('simulate', '-o', data, '--route', 'both', '--length', 700, '--every', 4, '--quiet')
    lines = lines_of(data)
    at = {line['frame']: (line['position']['x'], line['position']['z']) for line in lines}
    found = [line for line in lines if line.get('accepted')]
    loop = max(found, key=lambda line: line['score'] * (abs(line['yaw_deg']) > 90) * (line['match_frame'] > 100))
    query, place = (np.fromfile(data / f'sequences/00/velodyne/{loop[key]:06}.bin', np.float32).reshape(-1, 4)[:, :3] for key in ('frame', 'match_frame'))
    far, turn, relative = np.hypot(*query.T[:2]), 0.4999 - np.arctan2(*query.T[1::-1]) / 2.001 / np.pi, pose_of(loop['registered'])
    image, ring = np.full((48, 720), np.nan), np.full((24, 180), -2.0)
    image[np.clip((2 - np.degrees(np.arctan2(query[:, 2], far))) / 27 * 48, 0, 47).astype(int), (turn * 720).astype(int)] = far ** 0.5
    near = far < 48
    np.maximum.at(ring, ((far[near] / 2).astype(int), (turn[near] * 180).astype(int)), query[near, 2])
    figure, panels = plt.subplots(2, 3, figsize=(9.6, 5))
    for axes, clouds in ((panels[0, 0], [(query, CONTEXT)]), (panels[1, 1], [(place, RING), (query @ relative[:3, :3].T + relative[:3, 3], CONTEXT)])):
        for points, color in clouds:
            axes.scatter(*points[points[:, 2] > -1.2][::2, :2].T, s=1.2, color=color, linewidths=0)
        axes.set(xlim=(-42, 42), ylim=(-31, 31))
    panels[0, 1].imshow(image, aspect='auto', interpolation='nearest')
    panels[0, 2].imshow(np.where(ring > -2, ring, np.nan), aspect='auto', interpolation='nearest', origin='lower')
    panels[1, 0].plot(*np.array(list(at.values())).T, color=GRAY, linewidth=1.5)
    panels[1, 0].plot(*np.array([(at[line['frame']], at[line['match_frame']]) for line in found]).transpose(2, 1, 0), 'o-', color=RING, markersize=3, linewidth=1)
    panels[1, 0].set_aspect('equal', 'datalim')
    moved = ', '.join(f'{loop["registered"][axis]:.2f}' for axis in 'xyz')
    panels[1, 2].text(0.05, 0.9, f'{loop["match_frame"]} to {loop["frame"]}\n{moved} m, yaw {loop["yaw_deg"]:.1f}°\nprobability {loop["probability"]:.3f}\n'
                      'information: 6 x 6 matrix', va='top', fontsize=11, linespacing=1.8)
    for axes, title in zip(panels.flat, (f'1  scan {loop["frame"]}, from above', '2  range image', '3  ring: heights by direction and distance', '4  similar places in the map',
                                         f'5  registered to scan {loop["match_frame"]}', '6  edge of a pose graph')):
        axes.set(title=title, xticks=[], yticks=[])
        axes.spines[:].set(visible=True, color=GRID)
    save(figure, 'steps', 'png', dpi=110)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('name', nargs='*', help=f'{", ".join([*CHARTS, *PICTURES])}; default: all that can be drawn')
    parser.add_argument('--revisit', type=Path, help='the built program, for the pictures')
    parser.add_argument('--real', type=Path, default=ROOT / '../shared/real', help='folder of the real drives')
    options = parser.parse_args()
    os.environ['REVISIT'] = str(options.revisit)
    with tempfile.TemporaryDirectory() as folder:
        options.work = Path(folder)
        for name in options.name or [*CHARTS, *(PICTURES if options.revisit else ())]:
            if name in CHARTS:
                CHARTS[name]()
            elif name in PICTURES and options.revisit:
                PICTURES[name](options)
            else:
                raise SystemExit(f'figures: {name}: expected one of {", ".join(CHARTS)}, or with --revisit PROGRAM of {", ".join(PICTURES)}')


if __name__ == '__main__':
    main()
