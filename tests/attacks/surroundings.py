"""Console commands with limited memory and disk, and unusual home, streams and locales."""

import os
import resource
import subprocess
import sys
from pathlib import Path

from harness import CODES, MEGA, Case, Fault, run
from scans import room
from strangers import REVISIT, mean

LOOPS = [sys.executable, '-m', 'revisit.loops']
CONVERT = [sys.executable, '-m', 'revisit.conversion']
ODD = [b'\xff\xfe name', b'caf\xe9', 'größe'.encode(), b'new\nline', b'-dash', b"quote'\"", b'%s%n', b'\x1b[2J', b'x' * 200, b' ', b'a:b']


def drive(folder, name=b'drive', n=3):
    from revisit import datasets
    path = Path(os.fsdecode(os.path.join(os.fsencode(folder), name)))
    path.mkdir()
    for i in range(n):
        datasets.write_kitti_scan(path / f'{i:06}.bin', room(1)[::2].copy())
    return path


ALL = ['--sensor', 'hdl64', '--all', '--exclusion', 'frames=1', '--threshold', '0.3']
COMMANDS = {  # arguments for a folder and a drive in it
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
    mean('.npy')(folder)
    return COMMANDS[command_name](folder, drive(folder, name))


def surrounded(name, fine=False, **options):
    """`fine`: must succeed here."""
    def work(rng, folder):
        more = {key: value(folder) if callable(value) and key != 'preexec_fn' else value for key, value in options.items()}
        environment = {key: value for key, value in {**os.environ, **more.pop('env', {})}.items() if value is not None}
        done = ran(words_of(name, folder), env=environment, cwd=folder, codes=(0,) if fine else CODES, **more)
        if done.code:
            raise ValueError(f'exit code {done.code}: {done.err}')
    return work


def ran(words, **options):
    return run(words[0], words[1:], timeout=100, **options)


def without(*streams):
    def close():
        for stream in streams:
            os.close(stream)
    return close


def full(_):
    return open('/dev/full', 'wb')


def full_output(name):
    """Output cannot be written: one failure, reported once."""
    def work(rng, folder):
        with open('/dev/full', 'wb') as sink:
            done = ran(words_of(name, folder), stdout=sink, cwd=folder)
        if done.code == 0 and name not in ('revisit-loops -o', 'revisit-loops --report', 'revisit describe', 'revisit image'):
            raise Fault('says that it succeeded, and what it printed is lost')
        raise ValueError(done.err or 'nothing to say')
    return work


def gone_reader(name):
    """The reader exits immediately, like `head -c 1`."""
    def work(rng, folder):
        reads, writes = os.pipe()
        os.close(reads)
        try:
            done = ran(words_of(name, folder), stdout=writes, cwd=folder, codes=(*CODES, 141, -13), silent=True)
        finally:
            os.close(writes)
        if 'roken pipe' in done.err:
            raise Fault(done.err)
    return work


def named(name, odd, environment):
    def work(rng, folder):
        done = ran(words_of(name, folder, odd), env={**os.environ, **environment}, cwd=folder, codes=(0, 6))
        if '\x1b[2J' in done.err or '\x1b[2J' in done.out and 'jsonl' in name:
            raise Fault('the terminal is commanded')
    return work


def locales():
    found = subprocess.run(['locale', '-a'], capture_output=True, text=True).stdout.split()
    return ['C', 'POSIX'] + [name for name in ('C.utf8', 'de_DE.utf8', 'de_DE.UTF-8', 'tr_TR.utf8') if name in found] + ['de_DE.UTF-8', 'xx_XX']


def equal_in_locales(rng, folder):
    for name in ('revisit loops', 'revisit-loops'):
        words = words_of(name, folder, name.encode())
        answers = {ran(words, codes=(0,), env={**os.environ, 'LC_ALL': locale}, cwd=folder).out for locale in locales()}
        if len(answers) != 1:
            raise Fault(f'{name}: other output in another locale')


def read_only_home(folder):
    return {'HOME': '/proc', 'XDG_CACHE_HOME': '/proc', 'XDG_CONFIG_HOME': '/proc', 'MPLCONFIGDIR': None}


def cases():
    found = [Case('equal in locales', equal_in_locales)]
    for name in COMMANDS:
        for megabytes in (250, 400, 600, 800, 1200, 2000):  # below, libraries fail to load
            if 'revisit ' in name or megabytes >= 500:  # below, Python and numpy fail to start
                found.append(Case(f'{name}: ulimit -v of {megabytes} MB', surrounded(name, limits=[(resource.RLIMIT_AS, megabytes * MEGA)])))
        found += [
            Case(f'{name}: HOME read-only', surrounded(name, True, env=read_only_home)),
            Case(f'{name}: no HOME', surrounded(name, True, env={'HOME': None})),
            Case(f'{name}: HOME not there', surrounded(name, True, env={'HOME': '/nowhere/at/all'})),
            Case(f'{name}: TMPDIR not there', surrounded(name, True, env={'TMPDIR': '/nowhere/at/all'})),
            Case(f'{name}: no standard output', surrounded(name, stdout=None, stderr=None, silent=True, preexec_fn=without(1))),
            Case(f'{name}: no standard error', surrounded(name, stdout=None, stderr=None, silent=True, preexec_fn=without(2))),
            Case(f'{name}: no standard streams',
                 surrounded(name, stdin=None, stdout=None, stderr=None, silent=True, preexec_fn=without(0, 1, 2))),
            Case(f'{name}: full standard output', full_output(name)),
            Case(f'{name}: full standard error', surrounded(name, stderr=full, silent=True)),
            Case(f'{name}: nobody reads', gone_reader(name)),
            Case(f'{name}: files of at most 100 bytes', surrounded(name, limits=[(resource.RLIMIT_FSIZE, 100)])),
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
            found.append(Case(f'{name}: few files', surrounded(name, limits=[(resource.RLIMIT_NOFILE, 8)])))
    return found
