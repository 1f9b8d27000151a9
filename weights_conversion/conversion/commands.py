"""Subcommands of revisit-convert. They import packages when they run, so that the help needs none."""

from dataclasses import dataclass
from pathlib import Path
from typing import Callable

from . import files
from .errors import CheckFailed, UsageError

TOLERANCE = 1e-4  # relative to the maximum of an output: Winograd convolutions of libraries differ by this much


@dataclass
class Command:
    """Help texts, function that declares options, function that runs the command."""

    help: str
    description: str
    examples: str
    declare: Callable
    run: Callable


def _check_options(parser, tolerance=TOLERANCE):
    parser.add_argument('--no-check', dest='check', action='store_false', help='do not read back and compare')
    parser.add_argument('--tolerance', type=float, default=tolerance, metavar='E',
                        help='maximum difference, relative to the maximum of an output (default %(default)g)')


def _declare_weights(parser):
    parser.add_argument('input', metavar='IN', help='caffemodel of any version, .h5 or .npz')
    parser.add_argument('output', metavar='OUT', help='file to write: .caffemodel, .h5 or .npz')
    parser.add_argument('--float16', action='store_true', help='round to float16 (.npz only), half the size')


def _run_weights(options):
    from . import weights
    kind = weights.kind_of(options.output)
    if options.float16 and kind != 'npz':
        raise UsageError('--float16: expected an .npz output; caffemodel and HDF5 files have float32 only')
    files.may_write(options.force, options.output)
    content, types = weights.read_with_types(options.input)
    if kind == 'h5':
        for name in content:
            if '/' in name:
                print(f"note: the original Caffe cannot read layer '{name}' from HDF5 because of the '/'; revisit can")
                break
    stored = weights.to_float16(content) if options.float16 else content
    with files.appearing(options.output) as [part]:
        weights.write(part, stored, types)
        weights.require_same(weights.read(part), stored)
    arrays = [array for each in content.values() for array in each]
    print(f'{options.output}: {len(content)} layers, {sum(a.size for a in arrays)} numbers, verified by reading back')


def _declare_mean(parser):
    parser.add_argument('input', metavar='IN', help='.binaryproto or .npy')
    parser.add_argument('output', metavar='OUT', help='.npy or .binaryproto')


def _run_mean(options):
    import numpy as np
    from . import means
    if Path(options.output).suffix.lower() not in ('.npy', '.binaryproto'):
        raise UsageError(f'{options.output}: the name must end in .npy or .binaryproto')
    files.may_write(options.force, options.output)
    mean = means.read(options.input)
    with files.appearing(options.output) as [part]:
        means.write(part, mean)
        if not np.array_equal(means.read(part), mean, equal_nan=True):
            raise CheckFailed(f'check failed: {options.output} differs from {options.input}')
    print(f'{options.output}: {"x".join(map(str, mean.shape))}, verified by reading back')


def _declare_fold(parser):
    parser.add_argument('prototxt', metavar='PROTOTXT')
    parser.add_argument('weights', metavar='WEIGHTS', help='caffemodel, .h5 or .npz')
    parser.add_argument('out_prototxt', metavar='OUT.prototxt')
    parser.add_argument('out_weights', metavar='OUT.caffemodel', help='.caffemodel, .h5 or .npz')
    _inputs(parser)
    _check_options(parser)


def _run_fold(options):
    from . import fold, weights
    weights.kind_of(options.out_weights)
    files.may_write(options.force, options.out_prototxt, options.out_weights)
    fold.convert(options)


def _inputs(parser):
    parser.add_argument('--input-shape', action='append', default=[], metavar='[BLOB=]NxCxHxW',
                        help='shape of an input for the comparison')
    parser.add_argument('--input', action='append', default=[], metavar='[BLOB=]FILE.npy',
                        help='input for the comparison (default: random numbers)')


def _declare_onnx(parser):
    parser.add_argument('prototxt', metavar='PROTOTXT')
    parser.add_argument('weights', metavar='WEIGHTS', nargs='?', help='caffemodel, .h5 or .npz')
    parser.add_argument('output', metavar='OUT.onnx')
    parser.add_argument('--end', metavar='LAYER', help='truncate the net after this layer')
    parser.add_argument('--graft', metavar='LAYER', help='append a copy of this layer (without weights) after --end with its normalization and ReLU')
    parser.add_argument('--fixed', action='store_true', help='fix input sizes to those of the example (default: any sizes)')
    parser.add_argument('--float16', action='store_true', help='store weights as float16; the model computes in float32')
    _inputs(parser)
    _check_options(parser)


def _run_onnx(options):
    from . import onnx_export
    if Path(options.output).suffix.lower() != '.onnx':
        raise UsageError(f'{options.output}: the name must end in .onnx')
    files.may_write(options.force, options.output)
    with files.appearing(options.output) as [part]:
        onnx_export.export(options, part)
    print(f'{options.output}: {Path(options.output).stat().st_size} bytes')


def _to_caffe(parser):
    parser.add_argument('out_prototxt', metavar='OUT.prototxt')
    parser.add_argument('out_weights', metavar='OUT.caffemodel', help='.caffemodel, .h5 or .npz')
    parser.add_argument('--bgr', action='store_true', help='convert to BGR input, as usual in Caffe')
    parser.add_argument('--input-shape', metavar='NxCxHxW', help='input shape to write to the prototxt')
    _check_options(parser)


def _declare_matconvnet(parser):
    parser.add_argument('mat', metavar='FILE.mat')
    _to_caffe(parser)
    parser.add_argument('--mean', metavar='FILE', help='also write the mean image: .npy or .binaryproto')


def _run_matconvnet(options):
    from . import to_caffe, weights
    weights.kind_of(options.out_weights)
    if options.mean and Path(options.mean).suffix.lower() not in ('.npy', '.binaryproto'):
        raise UsageError(f'{options.mean}: the name must end in .npy or .binaryproto')
    files.may_write(options.force, *filter(None, (options.out_prototxt, options.out_weights, options.mean)))
    to_caffe.matconvnet(options)


def _declare_torch(parser):
    parser.add_argument('architecture', metavar='NAME', help='name in torchvision.models: alexnet, vgg16, resnet50, ...')
    parser.add_argument('state', metavar='STATE', help='state dict: .pth, .pt, .safetensors or .npz')
    _to_caffe(parser)
    parser.add_argument('--transform-input', action='store_true',
                        help="googlenet: include the input transform of torchvision's trained weights")


def _run_torch(options):
    from . import to_caffe, weights
    weights.kind_of(options.out_weights)
    files.may_write(options.force, options.out_prototxt, options.out_weights)
    to_caffe.torch(options)


COMMANDS = {
    'weights': Command(
        'weights between caffemodel, HDF5 and npz',
        "Write weights in another format. HDF5 files have Caffe's layout /data/LAYER/INDEX; npz files have the keys LAYER/INDEX. "
        "Files from before 2015 are upgraded. To upgrade a prototxt: 'revisit net upgrade old.prototxt new.prototxt'.",
        '  revisit-convert weights model.caffemodel model.h5\n'
        '  revisit-convert weights model.caffemodel half.npz --float16\n'
        '  revisit-convert weights half.npz model.caffemodel\n',
        _declare_weights, _run_weights),
    'mean': Command(
        'mean images between binaryproto and npy',
        'Write a mean image in the other format. The shape of the npy is [channels][height][width].',
        '  revisit-convert mean imagenet_mean.binaryproto mean.npy\n'
        '  revisit-convert mean mean.npy imagenet_mean.binaryproto\n',
        _declare_mean, _run_mean),
    'fold': Command(
        'fold BatchNorm and Scale into the previous layer',
        'Fold BatchNorm layers, and the Scale layers after them, into the weights of the Convolution or InnerProduct layers '
        'before them. Compares both networks.',
        '  revisit-convert fold deploy.prototxt model.caffemodel folded.prototxt folded.caffemodel\n',
        _declare_fold, _run_fold),
    'onnx': Command(
        'a Caffe network as an ONNX model',
        "Export a network to ONNX (opset 17). Compares ONNX Runtime's outputs with revisit's on the same input, and again at "
        'another input size. A net that ends in DetectionOutput (SSD) is truncated before it, with a note.',
        '  revisit-convert onnx deploy.prototxt model.caffemodel model.onnx\n'
        '  revisit-convert onnx deploy.prototxt model.caffemodel front.onnx --end conv3 --graft pool5 --input-shape 1x3x107x400\n'
        '  revisit-convert onnx deploy.prototxt model.npz half.onnx --float16\n',
        _declare_onnx, _run_onnx),
    'torch': Command(
        'networks of torchvision as Caffe networks',
        'Convert a network of torchvision (AlexNet, VGG, SqueezeNet, ResNet, ResNeXt, MobileNet v2, GoogLeNet) from its state dict. '
        "Compares PyTorch's outputs with revisit's if PyTorch and torchvision are installed. The network has the input of the "
        'original: for weights of torchvision, RGB images (x / 255 - mean) / deviation.',
        '  revisit-convert torch resnet50 resnet50.pth resnet50.prototxt resnet50.caffemodel\n'
        '  revisit-convert torch vgg16 vgg16.safetensors vgg16.prototxt vgg16.caffemodel --bgr\n',
        _declare_torch, _run_torch),
    'matconvnet': Command(
        'networks of MatConvNet as Caffe networks',
        "Convert a SimpleNN network of MatConvNet, such as imagenet-vgg-f.mat. Compares a NumPy reference of MatConvNet with revisit's "
        "outputs. The networks of MatConvNet's site take RGB images (0 to 255) minus the mean image.",
        '  revisit-convert matconvnet imagenet-vgg-s.mat vgg_s.prototxt vgg_s.caffemodel --bgr --mean vgg_s_mean.npy\n',
        _declare_matconvnet, _run_matconvnet),
}
