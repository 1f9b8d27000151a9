"""The command revisit-convert."""

import argparse
import os
import sys

from . import commands
from .errors import Error

EPILOG = """\
Exit codes: 0 ok; 1 failed; 2 usage; 3 input unreadable or malformed; 4 not supported (the message names layer and type);
5 a check failed: outputs differ from the original's, and nothing was written."""


class Parser(argparse.ArgumentParser):
    """Raises if the help cannot be written, which argparse ignores."""

    def print_help(self, file=None):
        print(self.format_help(), end='', file=file, flush=True)


def parser():
    """Returns the parser of all subcommands."""
    main = Parser(prog='revisit-convert', description='Convert trained networks between Caffe and other formats.',
                  epilog=EPILOG, formatter_class=argparse.RawDescriptionHelpFormatter)
    subparsers = main.add_subparsers(metavar='COMMAND', required=True)
    for name, command in commands.COMMANDS.items():
        sub = subparsers.add_parser(name, help=command.help, description=command.description,
                                    epilog='examples:\n' + command.examples,
                                    formatter_class=argparse.RawDescriptionHelpFormatter)
        command.declare(sub)
        sub.add_argument('--force', action='store_true', help='overwrite the outputs')
        sub.set_defaults(run=command.run)
    return main


def failed(why, code):
    # Escapes control characters, because names of files and layers are untrusted.
    shown = ''.join(c if c.isprintable() else ascii(c)[1:-1] for c in str(why))
    print(f'revisit-convert: {shown}', file=sys.stderr)
    return code


def write_no_more():
    """Discards buffered output that cannot be written, because flushing it at exit would fail again."""
    try:
        if sys.stdout is not None:
            sys.stdout.flush()
    except (OSError, ValueError):
        if sys.stdout is sys.__stdout__ and not sys.stdout.closed:  # not a caller's
            with open(os.devnull, 'w') as nowhere:
                os.dup2(nowhere.fileno(), sys.stdout.fileno())


def main(words=None):
    """Runs a command line; returns the exit code."""
    sys.stderr = sys.stderr or open(os.devnull, 'w')  # if it is closed, print() would write to standard output
    try:
        options = parser().parse_args(words)
        options.run(options)
        if sys.stdout is not None:
            sys.stdout.flush()
    except BrokenPipeError:  # the reader has exited, e.g. `head`
        write_no_more()
        return 1
    except Error as error:
        return failed(error, error.code)
    except KeyboardInterrupt:
        return 130
    except OSError as error:
        write_no_more()
        return failed(error, 1)
    except ModuleNotFoundError as error:
        return failed(f"needs the Python package '{error.name}' (pip install {error.name})", 1)
    except Exception as error:  # a bug or a system error: reported in one line
        return failed(f'{type(error).__name__}: {" ".join(str(error).split())}', 1)
    return 0


if __name__ == '__main__':
    sys.exit(main())
