"""The console commands where memory, disk, home, streams and locales are not as usual."""

import os
import resource
import subprocess
import sys
from pathlib import Path

from harness import MEGA, Case, Fault, command
from scans import room
from strangers import REVISIT, mean

LOOPS = [sys.executable, '-m', 'revisit.loops']
CONVERT = [sys.executable, '-m', 'revisit.conversion']
ODD = [b'\xff\xfe name', b'caf\xe9', 'größe'.encode(), b'new\nline', b'-dash', b"quote'\"", b'%s%n', b'\x1b[2J', b'x' * 200, b' ', b'a:b']


def drive(folder, name=b'drive', n=3):
    """Scans of a room, in a folder of this name."""
    from revisit import datasets
    path = Path(os.fsdecode(os.path.join(os.fsencode(folder), name)))
    path.mkdir()
    for i in range(n):
        datasets.write_kitti_scan(path / f'{i:06}.bin', room(1)[::2].copy())
    return path


ALL = ['--sensor', 'hdl64', '--all', '--exclusion', 'frames=1', '--threshold', '0.3']
COMMANDS = {  # its words, of a folder and a drive in it
    'revisit loops': lambda folder, path: [REVISIT, 'loops', path, *ALL],
    'revisit describe': lambda folder, path: [REVISIT, 'describe', path, '--feature', 'm2dp', '-o', folder / 'out.npy'],
    'revisit image': lambda folder, path: [REVISIT, 'image', path / '000000.bin', '-o', folder / 'o.png'],
    'revisit --help': lambda folder, path: [REVISIT, '--help'],
    'revisit doctor': lambda folder, path: [REVISIT, 'doctor'],
    'revisit-loops': lambda folder, path: [*LOOPS, path, *ALL],
    'revisit-loops --format jsonl': lambda folder, path: [*LOOPS, path, *ALL, '--format', 'jsonl'],
    'revisit-loops -o': lambda folder, path: [*LOOPS, path, *ALL, '-o', folder / 'o.csv'],
    'revisit-loops --report': lambda folder, path: [*LOOPS, path, *ALL, '--report', folder / 'o.html'],
    'revisit-loops --map': lambda folder, path: [*LOOPS, path, *ALL, '--map', folder / 'o.map'],
    'revisit-loops --help': lambda folder, path: [*LOOPS, '--help'],
    'revisit-convert mean': lambda folder, path: [*CONVERT, 'mean', folder / 'mean.npy', folder / 'o.binaryproto'],
    'revisit-convert --help': lambda folder, path: [*CONVERT, '--help'],
}


def words_of(command_name, folder, name=b'drive'):
    """A command, and what it reads."""
    mean('.npy')(folder)
    return COMMANDS[command_name](folder, drive(folder, name))


def surrounded(name, fine=False, **options):
    """`fine`: it must succeed here."""
    def work(rng, folder):
        more = {key: value(folder) if callable(value) and key != 'preexec_fn' else value for key, value in options.items()}
        environment = {**os.environ, **more.pop('env', {})}
        for key in [key for key, value in environment.items() if value is None]:
            del environment[key]
        done = command(words_of(name, folder), env=environment, cwd=folder, **more)
        if fine and done.returncode:
            raise Fault(f'exit code {done.returncode}: {done.stderr.decode(errors="replace")}')
        if done.returncode:
            raise ValueError(f'exit code {done.returncode}: {(done.stderr or b"").decode(errors="replace")}')
    return work


def within(megabytes):
    def limit():
        resource.setrlimit(resource.RLIMIT_AS, (megabytes * MEGA,) * 2)
    return limit


def without(*streams):
    def close():
        for stream in streams:
            os.close(stream)
    return close


def files_of_at_most(size):
    def limit():
        import signal
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (size, size))
    return limit


def few_files():
    resource.setrlimit(resource.RLIMIT_NOFILE, (8, 8))


def full(_):
    return open('/dev/full', 'wb')


def full_output(name):
    """What is printed cannot be written: that is a failure, said once."""
    def work(rng, folder):
        with open('/dev/full', 'wb') as sink:
            done = command(words_of(name, folder), stdout=sink, cwd=folder)
        if done.returncode == 0 and name not in ('revisit-loops -o', 'revisit-loops --report', 'revisit describe', 'revisit image'):
            raise Fault('says that it succeeded, and what it printed is lost')
        raise ValueError(done.stderr.decode(errors='replace') or 'nothing to say')
    return work


def gone_reader(name):
    """Whoever reads goes at once, as `head -c 1` does."""
    def work(rng, folder):
        reads, writes = os.pipe()
        os.close(reads)
        try:
            done = command(words_of(name, folder), stdout=writes, cwd=folder, codes=(0, 1, 2, 3, 4, 5, 6, 141, -13), must_say=False)
        finally:
            os.close(writes)
        if done.stderr.strip() and b'roken pipe' in done.stderr:
            raise Fault(f'{done.stderr}')
    return work


def named(name, odd, environment):
    def work(rng, folder):
        done = command(words_of(name, folder, odd), env={**os.environ, **environment}, cwd=folder)
        if done.returncode not in (0, 6):
            raise Fault(f'exit code {done.returncode}: {done.stderr.decode(errors="replace")}')
        if b'\x1b[2J' in done.stderr or b'\x1b[2J' in done.stdout and b'jsonl' in name.encode():
            raise Fault('the terminal is commanded')
    return work


def drive_named(odd, form):
    """The name of a drive that is no text, through a map and into a report."""
    def work(rng, folder):
        path = drive(folder)
        words = [
            *LOOPS, path, b'--drive=' + odd, '--sensor', 'hdl64', '--all', '--exclusion', 'frames=1', '--threshold', '0.3', '--map',
            folder / 'm.map', '--format', form, '-o', folder / f'o.{form}', '--report', folder / 'o.html'
        ]
        command(words, codes=(0,), cwd=folder)
        command(words, codes=(0,), cwd=folder)
    return work


def missing_file(name, odd):
    def work(rng, folder):
        words = {'revisit': [REVISIT, 'loops'], 'revisit-loops': LOOPS, 'revisit-convert': [*CONVERT, 'weights']}[name]
        done = command([*words, os.fsdecode(os.path.join(os.fsencode(folder), odd)) + '.npz',
                        folder / 'o.caffemodel'][:len(words) + (2 if name == 'revisit-convert' else 1)],
                       codes=(2, 3),
                       cwd=folder)
        if b'\x1b[2J' in done.stderr:
            raise Fault('the terminal is commanded')
        raise ValueError(done.stderr.decode(errors='replace'))
    return work


def locales():
    found = subprocess.run(['locale', '-a'], capture_output=True, text=True).stdout.split()
    return ['C', 'POSIX'] + [name for name in ('C.utf8', 'de_DE.utf8', 'de_DE.UTF-8', 'tr_TR.utf8') if name in found] + ['de_DE.UTF-8', 'xx_XX']


def equal_in_locales(rng, folder):
    """The same numbers whatever the locale."""
    for name in ('revisit loops', 'revisit-loops'):
        words = words_of(name, folder, name.encode())
        answers = {command(words, codes=(0,), env={**os.environ, 'LC_ALL': locale}, cwd=folder).stdout for locale in locales()}
        if len(answers) != 1:
            raise Fault(f'{name}: other output in another locale')


def read_only_home(folder):
    return {'HOME': '/proc', 'XDG_CACHE_HOME': '/proc', 'XDG_CONFIG_HOME': '/proc', 'MPLCONFIGDIR': None}


def cases():
    found = [Case('equal in locales', equal_in_locales)]
    for name in COMMANDS:
        for megabytes in (250, 400, 600, 800, 1200, 2000):  # below the libraries are not loaded
            if 'revisit ' in name or megabytes >= 500:  # below it Python and numpy cannot begin
                found.append(Case(f'{name}: ulimit -v of {megabytes} MB', surrounded(name, preexec_fn=within(megabytes))))
        found += [
            Case(f'{name}: HOME read-only', surrounded(name, True, env=read_only_home)),
            Case(f'{name}: no HOME', surrounded(name, True, env={'HOME': None})),
            Case(f'{name}: HOME not there', surrounded(name, True, env={'HOME': '/nowhere/at/all'})),
            Case(f'{name}: TMPDIR not there', surrounded(name, True, env={'TMPDIR': '/nowhere/at/all'})),
            Case(f'{name}: no standard output', surrounded(name, stdout=None, stderr=None, must_say=False, preexec_fn=without(1))),
            Case(f'{name}: no standard error', surrounded(name, stdout=None, stderr=None, must_say=False, preexec_fn=without(2))),
            Case(f'{name}: no standard streams',
                 surrounded(name, stdin=None, stdout=None, stderr=None, must_say=False, preexec_fn=without(0, 1, 2))),
            Case(f'{name}: full standard output', full_output(name)),
            Case(f'{name}: full standard error', surrounded(name, stderr=full, must_say=False)),
            Case(f'{name}: nobody reads', gone_reader(name)),
            Case(f'{name}: files of at most 100 bytes', surrounded(name, preexec_fn=files_of_at_most(100))),
            Case(f'{name}: no environment', surrounded(name, env={key: None for key in os.environ if key not in ('PYTHONPATH', 'PATH')}))
        ]
        found += [Case(f'{name}: LC_ALL={locale}', surrounded(name, True, env={'LC_ALL': locale})) for locale in locales()]
        if 'help' not in name and 'doctor' not in name and 'convert' not in name:
            found += [
                Case(f'{name}: data named {odd[:12]} {locale}', named(name, odd, {'LC_ALL': locale}), 600)
                for odd in ODD
                for locale in ('C', 'C.utf8')
            ]
        if name.startswith('revisit '):
            found.append(Case(f'{name}: few files', surrounded(name, preexec_fn=few_files)))
    found += [Case(f'a drive named {odd[:12]}, {form}', drive_named(odd, form)) for odd in ODD for form in ('csv', 'jsonl')]
    return found + [
        Case(f'{name}: {odd[:12]} is missing', missing_file(name, odd))
        for name in ('revisit', 'revisit-loops', 'revisit-convert')
        for odd in ODD
    ]
