"""The command revisit-convert."""

import argparse
import sys

from . import commands
from .errors import ConversionError

EPILOG = """\
Exit codes: 0 ok; 1 failed; 2 usage; 3 input unreadable or malformed; 4 not supported (the message names layer and type);
5 a check failed: what was converted does not compute the same, and nothing was written."""


def parser():
    """The parser of all subcommands."""
    main = argparse.ArgumentParser(prog='revisit-convert', description='Convert trained networks between Caffe and other formats.',
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


def main(words=None):
    """Runs a command line; returns the exit code."""
    options = parser().parse_args(words)
    try:
        options.run(options)
    except ConversionError as error:
        print(f'revisit-convert: {error}', file=sys.stderr)
        return error.code
    except KeyboardInterrupt:
        return 130
    except ModuleNotFoundError as error:
        print(f"revisit-convert: needs the Python package '{error.name}' (pip install {error.name})", file=sys.stderr)
        return 1
    except Exception as error:  # a fault of ours, or of the machine: one line all the same
        print(f'revisit-convert: {type(error).__name__}: {" ".join(str(error).split())}', file=sys.stderr)
        return 1
    return 0


if __name__ == '__main__':
    sys.exit(main())
