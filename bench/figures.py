#!/usr/bin/env python3
"""Draws the pictures of README.md and docs/ into docs/figures/.

  bench/figures.py                       all charts, from docs/data/
  bench/figures.py --revisit PROGRAM     also the two pictures of real scans, which `revisit loops` recognizes in REAL/nclt
  bench/figures.py speed_engines pair    only these

REAL is ../shared/real, or the option --real. Scans stay there: docs/figures/ gets pictures only. Needs numpy and matplotlib.
Backgrounds are opaque, so that pictures are readable in light and in dark themes.
"""

import argparse
import csv
import os
import sys
from pathlib import Path

import matplotlib
import numpy as np

matplotlib.use('Agg')
import matplotlib.pyplot as plt  # noqa: E402

sys.path.insert(0, str(Path(__file__).resolve().parent))
import tables  # noqa: E402
from loop_lines import lines_of, pose_of  # noqa: E402

ROOT = Path(__file__).resolve().parents[1]
FIGURES = ROOT / 'docs/figures'
RING, CONTEXT, TRAINED, PAPER, CLOSURES, GRAY, INK = '#1d4ed8', '#c2410c', '#f59e0b', '#15803d', '#7c3aed', '#9ca3af', '#111827'
METHODS = {'rings': RING, 'Scan Context, all candidates': CONTEXT, 'Scan Context, learnt as rings': TRAINED,
           "the paper's feature, best variant": PAPER, 'MapClosures, local maps of 20 m': CLOSURES}
QUERY, PLACE = '#c2410c', '#1d4ed8'
CHARTS, PICTURES = {}, {}

plt.rcParams.update({'font.size': 9, 'font.family': 'DejaVu Sans', 'axes.spines.top': False, 'axes.spines.right': False, 'axes.titlesize': 10,
                     'axes.titlelocation': 'left', 'figure.facecolor': 'white', 'axes.facecolor': 'white', 'legend.frameon': False,
                     'text.color': INK, 'axes.labelcolor': INK, 'xtick.color': INK, 'ytick.color': INK, 'svg.hashsalt': 'revisit'})


def register(functions):
    return lambda function: functions.setdefault(function.__name__, function)


chart, picture = register(CHARTS), register(PICTURES)


def rows_of(file):
    with (tables.DATA / file).open(newline='') as lines:
        return list(csv.DictReader(lines))


def save(figure, name, suffix='svg', **options):
    FIGURES.mkdir(exist_ok=True)
    file = FIGURES / f'{name}.{suffix}'
    figure.savefig(file, metadata={'Date': None} if suffix == 'svg' else None, **options)
    plt.close(figure)
    size = file.stat().st_size
    print(f'{file.relative_to(ROOT)}: {size / 1000:.0f} kB')
    if size > 200_000:
        raise SystemExit(f'figures: {file} is larger than 200 kB')


def bars(axes, labels, series, form, unit):
    """series: name -> (color, a value or None for each label)."""
    height = 0.8 / len(series)
    for k, (name, (color, values)) in enumerate(series.items()):
        at = np.arange(len(labels)) + (k - (len(series) - 1) / 2) * height
        axes.barh(at, [value or 0 for value in values], height * 0.9, color=color, label=name)
        for y, value in zip(at, values):
            axes.text(value or 0, y, ' ' + ('not run' if value is None else form.format(value)), va='center', fontsize=7,
                      color=GRAY if value is None else INK)
    axes.set_yticks(range(len(labels)), labels)
    axes.invert_yaxis()
    axes.tick_params(axis='y', length=0)
    axes.set_xlabel(unit)
    axes.margins(y=0.02)


def name_of(row_name):
    return {'rings': 'ring descriptor (revisit)'}.get(row_name, tables.shown(row_name))


def best(rows, method):
    """Mean AP of a method, of the paper's feature the best variant; None if it was not run."""
    return tables.best_mean(rows, tables.BRIEF.get(method, (method,)))[0]


@chart
def results_real():
    """How well are places recognized on real drives?"""
    rows = tables.rows_of('real_drives.json')
    drives = [drive for drive in tables.DRIVES if any(row['drive'] == drive for row in rows)]
    series = {}
    for method, color in METHODS.items():
        found = [best([row for row in rows if row['drive'] == drive], method) for drive in drives]
        series[name_of(method)] = color, found
    figure, axes = plt.subplots(figsize=(7.2, 4.6), layout='constrained')
    bars(axes, [tables.DRIVES[drive].replace(', ', '\n') for drive in drives], series, '{:.3f}', 'average precision (AP)')
    axes.set(xlim=(0, 1.08), title='Real drives')
    figure.legend(loc='outside lower center', ncols=3, fontsize=8)
    save(figure, 'results_real')


@chart
def results_simulated():
    """How well on simulated drives, in the opposite direction?"""
    rows = [(match, row) for row in tables.rows_of('towns.json') if row.get('keyframes') == 1.0
            and (match := tables.TOWN.fullmatch(row['drive'])) and match[1] == '08']
    sensors = list(dict.fromkeys(match[2] for match, _ in rows))
    series = {}
    for method, color in METHODS.items():
        found = [best([row for match, row in rows if match[2] == sensor], method) for sensor in sensors]
        if any(found):
            series[name_of(method)] = color, found
    figure, axes = plt.subplots(figsize=(7.2, 3.4), layout='constrained')
    bars(axes, [tables.SENSORS[sensor] for sensor in sensors], series, '{:.3f}', 'average precision (AP), mean over towns')
    axes.set(xlim=(0, 1.08), title="Simulated towns, KITTI's route 08 in the opposite direction, keyframes of 1 m")
    figure.legend(loc='outside lower center', ncols=2, fontsize=8)
    save(figure, 'results_simulated')


@chart
def results_perturbed():
    """How robust are descriptors to perturbed scans?"""
    rows = tables.rows_of('perturbed_scans.json')
    drives = [drive for drive in ('nclt', 'riverside') if any(row['drive'] == drive for row in rows)]
    steps = list(dict.fromkeys(row['perturbation'] for row in rows))
    figure, all_axes = plt.subplots(1, len(drives), figsize=(8.6, 5.2), sharey=True, layout='constrained')
    for axes, drive in zip(np.atleast_1d(all_axes), drives):
        value = {(row['name'], row['perturbation']): row['recall_at_1'] for row in rows if row['drive'] == drive}
        pairs = [[value.get((method, step), np.nan) for step in steps] for method in ('rings', 'Scan Context')]
        y = np.arange(len(steps))
        axes.hlines(y, *pairs, color=GRAY, linewidth=1)
        axes.scatter(pairs[0], y, color=RING, s=26, zorder=3, label='ring descriptor (revisit)')
        axes.scatter(pairs[1], y, color=CONTEXT, s=26, marker='s', zorder=3, label='Scan Context')
        axes.set(xlim=(-0.02, 1.02), xlabel='recall@1', title=tables.DRIVES[drive])
        axes.grid(axis='x', color='#e5e7eb')
        axes.set_axisbelow(True)
    axes.set_yticks(y, steps, fontsize=8)
    axes.invert_yaxis()
    figure.legend(*axes.get_legend_handles_labels(), loc='outside lower center', ncols=2)
    save(figure, 'results_perturbed')


def times_as_long(name, file, machine, engines, title):
    rows = [row for row in rows_of(file) if row['machine'] == machine and row['threads'] == '1']
    labels = [f'{row["net"]}\n{row["input"]}: {float(row["revisit_min_ms"]):.1f} ms' for row in rows]
    series = {title_of: (color, [float(row[column]) for row in rows]) for column, (title_of, color) in engines.items()}
    figure, axes = plt.subplots(figsize=(7.2, 0.55 * len(rows) + 1.5), layout='constrained')
    bars(axes, labels, series, '{:.2f}', 'times as long as revisit (1 = revisit, float32); fastest pass, one thread')
    axes.axvline(1, color=RING, linewidth=1.5)
    axes.set_title(title)
    axes.margins(x=0.08)
    figure.legend(loc='outside lower center', ncols=3, fontsize=8)
    save(figure, name)


@chart
def speed_engines():
    """How fast is a network, compared with oneDNN, Caffe's algorithm and OpenCV?"""
    engines = {'onednn_times_as_long_min': ('oneDNN 2.6', TRAINED), 'im2col_openblas_times_as_long_min': ('im2col + OpenBLAS, as Caffe', CONTEXT),
               'opencv_dnn_times_as_long_min': ('OpenCV dnn 4.6', GRAY)}
    times_as_long('speed_engines', 'speed_engines.csv', 'Intel Sapphire Rapids', engines, 'Intel Sapphire Rapids')


@chart
def speed_peers():
    """How fast compared with ONNX Runtime and OpenVINO?"""
    engines = {'onnxruntime_times_as_long_min': ('ONNX Runtime 1.32', CONTEXT), 'openvino_times_as_long_min': ('OpenVINO 2026.4', TRAINED)}
    times_as_long('speed_peers', 'speed_peers.csv', 'AMD EPYC (Zen 4)', engines, 'AMD EPYC (Zen 4), float32')


@chart
def speed_bf16():
    """What does bfloat16 gain?"""
    rows = [row for row in rows_of('speed_peers.csv') if row['threads'] == '1']
    figure, all_axes = plt.subplots(1, 2, figsize=(8.6, 4.4), sharey=True, layout='constrained')
    for axes, machine in zip(all_axes, dict.fromkeys(row['machine'] for row in rows)):
        chosen = [row for row in rows if row['machine'] == machine]
        series = {name: (color, [float(row['revisit_min_ms']) / float(row[column]) for row in chosen])
                  for name, column, color in (('revisit', 'revisit_bf16_min_ms', RING), ('OpenVINO', 'openvino_bf16_min_ms', TRAINED))}
        bars(axes, [f'{row["net"]}, {row["input"]}' for row in chosen], series, '{:.2f}', 'bf16: times as fast as revisit in float32')
        axes.set_title(machine)
        axes.margins(x=0.12)
    all_axes[1].invert_yaxis()  # shared: bars() turned it twice
    figure.legend(*axes.get_legend_handles_labels(), loc='outside lower center', ncols=2)
    save(figure, 'speed_bf16')


@chart
def speed_sizes():
    """How does time grow with the image, and what do threads gain?"""
    figure, (left, right) = plt.subplots(1, 2, figsize=(8.6, 3.4), layout='constrained')
    columns = (1000, 2000, 4000, 8000, 16000)
    colors = dict(zip(('AlexNet', 'VGG-CNN-S', 'Places-CNDS-8'), (RING, CONTEXT, PAPER)))
    for row in rows_of('speed_sizes.csv'):
        left.loglog(columns, [float(row[f'columns_{n}_ms']) for n in columns], color=colors[row['net']], marker='o', markersize=3,
                    linestyle='-' if row['threads'] == '1' else '--',
                    label=f'{row["net"]}, {row["threads"]} thread{"s" if row["threads"] != "1" else ""}')
    left.set(xlabel='columns of a range image', ylabel='ms', title='Time by width (Intel Sapphire Rapids)')
    left.set_xticks(columns, map(str, columns))
    left.minorticks_off()
    left.legend(fontsize=7)
    rows = rows_of('speed_threads.csv')
    counts = (1, 2, 8, 16)
    for row in rows:
        right.plot(counts, [1, *(float(row[f'speedup_{n}_threads']) for n in counts[1:])], color=GRAY, linewidth=1)
    for row in (max(rows, key=lambda row: float(row['speedup_16_threads'])), min(rows, key=lambda row: float(row['speedup_16_threads']))):
        right.plot(counts, [1, *(float(row[f'speedup_{n}_threads']) for n in counts[1:])], color=RING, linewidth=2, marker='o', markersize=3)
        right.text(16, float(row['speedup_16_threads']), ' ' + row['net'].split()[0], va='center', fontsize=8)
    right.plot((1, 16), (1, 16), color=INK, linewidth=0.8, linestyle=':')
    right.set(xlabel='threads', ylabel='times as fast as one thread', xlim=(0, 21), title='Threads, predicted from work pieces (Zen 4)')
    right.set_xticks(counts)
    save(figure, 'speed_sizes')


@chart
def speed_maps():
    """How long does a query take in a large map?"""
    figure, axes = plt.subplots(figsize=(6.4, 3.6), layout='constrained')
    rings = [row for row in rows_of('speed_ring_maps.csv') if row['candidates'] == '1000']
    entries = [int(row['map_entries']) for row in rings]
    axes.loglog(entries, [float(row['all_yaw_angles_median_ms']) for row in rings], color=RING, linestyle='--', marker='o', markersize=4,
                label='ring descriptor, every map entry at all yaw angles')
    axes.loglog(entries, [float(row['with_codes_median_ms']) for row in rings], color=RING, marker='o', markersize=4,
                label='ring descriptor, 1000 candidates by compact codes (default)')
    cosines = [row for row in rows_of('speed_large_maps.csv') if row['search'] == 'exact' and row['similarity'] == 'cosines']
    axes.loglog([int(row['map_entries']) for row in cosines], [float(row['p50_ms']) for row in cosines], color=PAPER, marker='s', markersize=4,
                label='cosines of 400 dimensions, exact')
    axes.set(xlabel='map entries', ylabel='ms per query, one thread', title='AMD EPYC')
    axes.grid(color='#e5e7eb')
    axes.legend(fontsize=8)
    save(figure, 'speed_maps')


@chart
def speed_methods():
    """How many scans per second does each method describe?"""
    rows = sorted(rows_of('speed_methods.csv'), key=lambda row: -float(row['frames_per_s']))
    figure, axes = plt.subplots(figsize=(6.8, 3.2), layout='constrained')
    bars(axes, [row['method'].split(' (')[0] for row in rows],
         {'here': (RING, [float(row['frames_per_s']) for row in rows]),
          'in the paper, on its machine': (GRAY, [float(row['frames_per_s_in_paper']) if row['frames_per_s_in_paper'] else None for row in rows])},
         '{:.1f}', 'scans per second, one thread (log scale)')
    axes.set_xscale('log')
    axes.set_xlim(1, 1500)
    for text in axes.texts:
        text.set_x(max(text.get_position()[0], 1))
        text.set_text(text.get_text().replace('not run', '-'))
    figure.legend(loc='outside lower center', ncols=2, fontsize=8)
    save(figure, 'speed_methods')


@chart
def accuracy():
    """How far are outputs from the original Caffe's?"""
    rows = rows_of('accuracy_float32.csv')
    figure, (left, right) = plt.subplots(1, 2, figsize=(9, 4.2), layout='constrained')
    names = [row['net'].removeprefix('reduced-width ') for row in rows]
    y = np.arange(len(rows))
    for column, marker, color, title in (('default', 'o', RING, 'default'), ('strict', 's', TRAINED, '--accuracy strict'),
                                         ('without_winograd', '|', INK, 'without Winograd')):
        left.semilogx([float(row[column]) for row in rows], y, linestyle='', marker=marker, color=color, label=title,
                      markersize=9 if marker == '|' else 5)
    left.set_yticks(y, names, fontsize=7)
    left.set(title='Engine, largest error of a layer', xlabel='max |a - b| / max |b|')
    rows = rows_of('accuracy_onnx.csv')
    y = np.arange(len(rows))
    right.semilogx([float(row['from_caffe']) for row in rows], y, 'o', color=CONTEXT, markersize=5, label='from Caffe')
    right.semilogx([float(row['from_engine']) for row in rows], y, 'x', color=INK, markersize=5, label='from the engine')
    right.set_yticks(y, [f'{row["net"]}{"" if i < 8 else ", reduced width"}' for i, row in enumerate(rows)], fontsize=7)
    right.set(title='ONNX models, worst output', xlabel='max |a - b| / max |b|')
    for axes in (left, right):
        axes.invert_yaxis()
        axes.grid(axis='x', color='#e5e7eb')
        axes.set_axisbelow(True)
        axes.legend(loc='upper center', bbox_to_anchor=(0.5, -0.16), ncols=3, fontsize=7, handletextpad=0.2, columnspacing=0.8)
    save(figure, 'accuracy')


def loops_of(real, *options):
    return lines_of(real / 'nclt/bin', '--poses', real / 'nclt/poses_kitti.txt', '--pose-frame', 'lidar', '--exclusion', 'meters=50',
                    '--odometry-gate', 'none', *options)


def top_down(axes, clouds, title, reach=42):
    for points, color in clouds:
        axes.scatter(*points[:, :2].T, s=0.7, color=color, linewidths=0, rasterized=True)
    axes.set(xlim=(-reach, reach), ylim=(-reach * 0.8, reach * 0.8), xticks=[], yticks=[], aspect='equal')
    axes.set_title(title, fontsize=9)
    axes.spines[:].set(visible=True, color='#d1d5db')


@picture
def pair(real):
    accepted = [loop for loop in loops_of(real) if loop.get('accepted')]
    loop = max(accepted, key=lambda loop: loop['score'])
    query, place = (np.fromfile(real / f'nclt/bin/{loop[key]:06}.bin', np.float32).reshape(-1, 4)[:, :3] for key in ('frame', 'match_frame'))
    relative = pose_of(loop['registered'])
    moved = query @ relative[:3, :3].T + relative[:3, 3]
    upright = [points[points[:, 2] > np.percentile(points[:, 2], 5) + 0.5] for points in (query, place, moved)]
    figure, axes = plt.subplots(1, 3, figsize=(10, 2.95), layout='constrained')
    top_down(axes[0], [(upright[0], QUERY)], f'Query: scan {loop["frame"]}')
    top_down(axes[1], [(upright[1], PLACE)], f'Recognized as: scan {loop["match_frame"]}')
    top_down(axes[2], [(upright[1], PLACE), (upright[2], QUERY)], f'Overlaid by the estimated pose, yaw {loop["yaw_deg"]:.0f} degrees')
    axes[2].plot([28, 38], [-30, -30], color=INK, linewidth=2)
    axes[2].text(33, -29, '10 m', ha='center', va='bottom', fontsize=8)
    for panel in axes:
        panel.plot(0, 0, marker='+', color=INK, markersize=8)
    save(figure, 'pair', 'png', dpi=110)


@picture
def loops(real):
    """The accepted loops of a real drive, whole, and where it comes back."""
    lines = loops_of(real)
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
    figure, panels = plt.subplots(1, 2, figsize=(9, 2.7), layout='constrained')
    titles = f'NCLT, HDL-32E: {len(path)} scans, {driven[-1]:.0f} m', 'The part that is driven twice'
    for axes, size, bar, title in zip(panels, (1, 3), (50, 20), titles):
        axes.plot(*path.T, color=GRAY, linewidth=1.5, zorder=1)
        axes.plot(*pairs.transpose(2, 1, 0), color=RING, linewidth=0.6 * size, zorder=2)
        for points, color, marker, area, what in ((pairs[~wrong, 0], RING, 'o', 5, 'accepted loops, within 10 m'),
                                                  (pairs[wrong, 0], '#dc2626', 'o', 12, 'accepted loops, beyond 10 m'),
                                                  (missed, INK, 'x', 12, 'places within 5 m, not accepted')):
            axes.scatter(*points.T, s=area * size, color=color, marker=marker, zorder=3, label=f'{what}: {len(points)}')
        axes.set(title=title, xticks=[], yticks=[], aspect='equal', **({'xlim': (middle - 70, middle + 70), 'ylim': (low, high)} if size > 1 else {}))
        axes.spines[:].set(visible=True, color='#d1d5db')
        right, bottom = axes.get_xlim()[1], axes.get_ylim()[0]
        axes.plot([right - bar - 5, right - 5], [bottom + bar / 5] * 2, color=INK, linewidth=2)
        axes.text(right - bar / 2 - 5, bottom + bar / 4, f'{bar} m', ha='center', va='bottom', fontsize=8)
    panels[0].legend(fontsize=7, loc='lower left')
    save(figure, 'loops')


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('name', nargs='*', help=f'{", ".join([*CHARTS, *PICTURES])}; default: all that can be drawn')
    parser.add_argument('--revisit', type=Path, help='the built program, for the pictures of real scans')
    parser.add_argument('--real', type=Path, default=ROOT / '../shared/real', help='folder of the real drives')
    options = parser.parse_args()
    os.environ['REVISIT'] = str(options.revisit)
    names = options.name or [*CHARTS, *(PICTURES if options.revisit and options.real.exists() else ())]
    for name in names:
        if name in PICTURES and options.revisit:
            PICTURES[name](options.real)
        elif name in CHARTS:
            CHARTS[name]()
        else:
            raise SystemExit(f'figures: {name}: expected one of {", ".join(CHARTS)}, or with --revisit PROGRAM of {", ".join(PICTURES)}')


if __name__ == '__main__':
    main()
