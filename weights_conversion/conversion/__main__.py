"""The command revisit-convert."""

import argparse
import os
import sys

from . import commands
from .errors import Error

EPILOG = """\
Exit codes: 0 ok; 1 failed; 2 usage; 3 input unreadable or malformed; 4 not supported (the message names layer and type);
5 a check failed: what was converted does not compute the same, and nothing was written."""


class Parser(argparse.ArgumentParser):
    """argparse itself says nothing when its help cannot be written."""

    def print_help(self, file=None):
        print(self.format_help(), end='', file=file, flush=True)


def parser():
    """The parser of all subcommands."""
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
    # As a terminal can show it without obeying it: names of files and layers hold what their makers like.
    shown = ''.join(c if c.isprintable() else ascii(c)[1:-1] for c in str(why))
    print(f'revisit-convert: {shown}', file=sys.stderr)
    return code


def write_no_more():
    """What standard output still holds, and cannot be written, would be an error once more when Python ends."""
    try:
        if sys.stdout is not None:
            sys.stdout.flush()
    except (OSError, ValueError):
        if sys.stdout is sys.__stdout__ and not sys.stdout.closed:  # not a caller's
            with open(os.devnull, 'w') as nowhere:
                os.dup2(nowhere.fileno(), sys.stdout.fileno())


def main(words=None):
    """Runs a command line; returns the exit code."""
    sys.stderr = sys.stderr or open(os.devnull, 'w')  # where it is closed, print() would take standard output
    try:
        options = parser().parse_args(words)
        options.run(options)
        if sys.stdout is not None:
            sys.stdout.flush()
    except BrokenPipeError:  # whoever read has gone, as `head` does
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
    except Exception as error:  # a fault of ours, or of the machine: one line all the same
        return failed(f'{type(error).__name__}: {" ".join(str(error).split())}', 1)
    return 0


if __name__ == '__main__':
    sys.exit(main())
