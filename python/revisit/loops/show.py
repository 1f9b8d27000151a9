"""Plot of the loops with matplotlib."""

import math

from revisit.errors import Error


def need_matplotlib():
    try:
        import matplotlib
    except ImportError as error:
        raise Error(f'the plot needs the package matplotlib: pip install matplotlib ({error})') from None
    matplotlib.use('Agg')


def plot(lines, file):
    """Plots a top-down map (x right, z up), or without poses the matched frame of each loop."""
    need_matplotlib()
    from matplotlib import pyplot
    figure, axes = pyplot.subplots(figsize=(7, 7), layout='constrained')
    loops = [line for line in lines if line.get('accepted')]
    if any('position' in line for line in lines):
        def ground(line, name='position'):
            at = line.get(name)
            return (at['x'], at['z']) if at else (math.nan, math.nan)
        axes.plot(*zip(*map(ground, lines)), '.-', color='lightgray', markersize=2, label='scans')
        for line in loops:
            axes.plot(*zip(ground(line), ground(line, 'match_position')), color='tab:green', linewidth=1)
        if loops:
            axes.plot(*zip(*map(ground, loops)), '.', color='tab:green', label='loop closures')
        axes.set_aspect('equal', adjustable='datalim')
        axes.set_xlabel('[m]')
        axes.set_ylabel('[m]')
    else:
        axes.plot([line['frame'] for line in loops], [line['match_frame'] for line in loops], '.', color='tab:green',
                  label='loop closures')
        axes.set_xlabel('frame')
        axes.set_ylabel('matched frame')
    axes.legend()
    axes.set_title(f'{len(loops)} loops')
    try:
        figure.savefig(file)
    except (OSError, ValueError) as error:
        raise Error(f'{file}: cannot be written: {error}') from None
    pyplot.close(figure)
