"""The command revisit-convert. Subcommands import packages when they run, so that the help needs none."""

import argparse
import importlib
import os
import sys
from dataclasses import dataclass

from revisit.errors import Error

EPILOG = """\
Exit codes: 0 ok; 1 failed; 2 usage; 3 input unreadable or malformed; 4 not supported (the message names layer and type);
5 a check failed: outputs differ from the original's, and nothing was written."""

OPTIONS = {
    '--bgr': dict(action='store_true', help='convert to BGR input, as usual in Caffe'),
    '--end': dict(default='', metavar='LAYER[+LAYER]',
                  help='truncate the net after this layer; conv3+pool5 appends a copy of pool5, which has no weights, with its '
                       'normalization and ReLU'),
    '--fixed': dict(action='store_true', help='fix input sizes to those of the example (default: any sizes)'),
    '--float16': dict(action='store_true', help='store weights as float16: half the size (.npz and .onnx)'),
    '--input': dict(action='append', default=[], metavar='[BLOB=]NxCxHxW or [BLOB=]FILE.npy',
                    help='shape or values of an input (default: random numbers of the shape in the prototxt)'),
    '--no-check': dict(dest='check', action='store_false', help='do not read back and compare'),
}
WEIGHTS = '.caffemodel, .h5 or .npz'
NET = ('prototxt', 'PROTOTXT', ''), ('weights', 'WEIGHTS', WEIGHTS)
WEIGHTS_ENDINGS, MEAN_ENDINGS = ('.caffemodel', '.h5', '.hdf5', '.npz'), ('.npy', '.binaryproto')
TO_CAFFE = ('out_prototxt', 'OUT.prototxt', '', ()), ('out_weights', 'OUT.caffemodel', WEIGHTS, WEIGHTS_ENDINGS)


@dataclass
class Command:
    """arguments: tuples (name, metavar, help), optional if the metavar has brackets. Outputs have the endings that their names may
    have, too; none: any. options: keys of OPTIONS. run: module and function of this package.
    """

    help: str
    description: str
    examples: str
    arguments: tuple
    options: str
    run: str

    def outputs(self, options):
        """Returns pairs (path, endings)."""
        given = [(getattr(options, name), *endings) for name, _, _, *endings in self.arguments if endings]
        return [(path, endings) for path, endings in given if path]

    def __call__(self, options):
        from .files import may_write
        may_write(self.outputs(options))
        module, function = self.run.split(':')
        getattr(importlib.import_module(f'.{module}', __package__), function)(options)


COMMANDS = {
    'weights': Command(
        'weights between caffemodel, HDF5 and npz',
        "Write weights in another format. HDF5 files have Caffe's layout /data/LAYER/INDEX; npz files have the keys LAYER/INDEX. "
        "Files from before 2015 are upgraded. To upgrade a prototxt: 'revisit net upgrade old.prototxt new.prototxt'.",
        '  revisit-convert weights model.caffemodel model.h5\n'
        '  revisit-convert weights model.caffemodel half.npz --float16\n'
        '  revisit-convert weights half.npz model.caffemodel\n',
        (('input_file', 'IN', 'caffemodel of any version, .h5 or .npz'), ('output', 'OUT', WEIGHTS, WEIGHTS_ENDINGS)), '--float16',
        'weights:convert'),
    'mean': Command(
        'mean images between binaryproto and npy',
        'Write a mean image in the other format. The shape of the npy is [channels][height][width].',
        '  revisit-convert mean imagenet_mean.binaryproto mean.npy\n'
        '  revisit-convert mean mean.npy imagenet_mean.binaryproto\n',
        (('input_file', 'IN', '.binaryproto or .npy'), ('output', 'OUT', '.npy or .binaryproto', MEAN_ENDINGS)), '', 'weights:convert_mean'),
    'fold': Command(
        'fold BatchNorm and Scale into the previous layer',
        'Fold BatchNorm layers, and the Scale layers after them, into the weights of the Convolution or InnerProduct layers '
        'before them. Compares both networks.',
        '  revisit-convert fold deploy.prototxt model.caffemodel folded.prototxt folded.caffemodel\n',
        (*NET, *TO_CAFFE), '--input --no-check', 'fold:convert'),
    'onnx': Command(
        'a Caffe network as an ONNX model',
        "Export a network to ONNX (opset 17). Compares ONNX Runtime's outputs with revisit's on the same input, and again at "
        'another input size. A net that ends in BoxOutput (MS-CNN) is truncated before it, with a note.',
        '  revisit-convert onnx deploy.prototxt model.caffemodel model.onnx\n'
        '  revisit-convert onnx deploy.prototxt model.caffemodel front.onnx --end conv3+pool5 --input 1x3x107x400\n'
        '  revisit-convert onnx deploy.prototxt model.npz half.onnx --float16\n',
        (('prototxt', 'PROTOTXT', ''), ('weights', '[WEIGHTS]', WEIGHTS), ('output', 'OUT.onnx', '', ('.onnx',))),
        '--end --fixed --float16 --input --no-check', 'onnx_export:export'),
    'torch': Command(
        'networks of torchvision as Caffe networks',
        'Convert a network of torchvision (AlexNet, VGG, SqueezeNet, ResNet, ResNeXt, MobileNet v2, GoogLeNet) from its state dict. '
        "Compares PyTorch's outputs with revisit's if PyTorch and torchvision are installed. The network has the input of the "
        'original: for weights of torchvision, RGB images (x / 255 - mean) / deviation. The network googlenet_transform_input is '
        "googlenet with the preprocessing of torchvision's trained weights.",
        '  revisit-convert torch resnet50 resnet50.pth resnet50.prototxt resnet50.caffemodel\n'
        '  revisit-convert torch vgg16 vgg16.safetensors vgg16.prototxt vgg16.caffemodel --bgr\n',
        (('architecture', 'NAME', 'name in torchvision.models: alexnet, vgg16, resnet50, ...'),
         ('state', 'STATE', 'state dict: .pth, .pt, .safetensors or .npz'), *TO_CAFFE), '--bgr --input --no-check', 'to_caffe:torch'),
    'matconvnet': Command(
        'networks of MatConvNet as Caffe networks',
        "Convert a SimpleNN network of MatConvNet, such as imagenet-vgg-f.mat. Compares a NumPy reference of MatConvNet with revisit's "
        "outputs. The networks of MatConvNet's site take RGB images (0 to 255) minus the mean image.",
        '  revisit-convert matconvnet imagenet-vgg-s.mat vgg_s.prototxt vgg_s.caffemodel vgg_s_mean.npy --bgr\n',
        (('mat', 'FILE.mat', ''), *TO_CAFFE, ('mean', '[MEAN]', 'mean image to write: .npy or .binaryproto', MEAN_ENDINGS)),
        '--bgr --input --no-check', 'to_caffe:matconvnet'),
}


class Parser(argparse.ArgumentParser):
    """Raises if the help cannot be written, which argparse ignores."""

    def print_help(self, file=None):
        print(self.format_help(), end='', file=file, flush=True)


def parser():
    """Returns the parser of all subcommands."""
    main = Parser(prog='revisit-convert', description='Convert trained networks between Caffe and other formats.',
                  epilog=EPILOG, formatter_class=argparse.RawDescriptionHelpFormatter)
    subparsers = main.add_subparsers(metavar='COMMAND', required=True)
    for name, command in COMMANDS.items():
        sub = subparsers.add_parser(name, help=command.help, description=command.description,
                                    epilog='examples:\n' + command.examples,
                                    formatter_class=argparse.RawDescriptionHelpFormatter)
        for argument, metavar, text, *_ in command.arguments:
            sub.add_argument(argument, metavar=metavar.strip('[]'), nargs='?' if '[' in metavar else None, help=text)
        for option in command.options.split():
            sub.add_argument(option, **OPTIONS[option])
        sub.set_defaults(run=command)
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
