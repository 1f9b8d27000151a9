"""The subcommands of revisit-convert. What they need is imported when they run: help needs no packages."""

from dataclasses import dataclass
from pathlib import Path
from typing import Callable

from . import files
from .errors import CheckFailed, UsageError

TOLERANCE = 1e-4  # of the largest number of an output: what Winograd's convolutions differ by among libraries


@dataclass
class Command:
    """What the help says, the options, and what is done."""

    help: str
    description: str
    examples: str
    declare: Callable
    run: Callable


def _check_options(parser, tolerance=TOLERANCE):
    parser.add_argument('--no-check', dest='check', action='store_false', help='do not read back and compare')
    parser.add_argument('--tolerance', type=float, default=tolerance, metavar='E',
                        help='largest difference, in parts of the largest number of an output (default %(default)g)')


def _declare_weights(parser):
    parser.add_argument('input', metavar='IN', help='a caffemodel of any age, .h5 or .npz')
    parser.add_argument('output', metavar='OUT', help='the file to write: .caffemodel, .h5 or .npz')
    parser.add_argument('--float16', action='store_true', help='round to float16 (.npz): half the size')


def _run_weights(options):
    from . import weights
    kind = weights.kind_of(options.output)
    if options.float16 and kind != 'npz':
        raise UsageError('--float16 is for .npz: a caffemodel holds float32 only, and so does the HDF5 of revisit')
    files.may_write(options.force, options.output)
    content, types = weights.read_with_types(options.input)
    if kind == 'h5':
        for name in content:
            if '/' in name:
                print(f"note: the original Caffe does not find '{name}' in HDF5, because of the '/'; revisit does")
                break
    stored = weights.to_float16(content) if options.float16 else content
    with files.appearing(options.output) as [part]:
        weights.write(part, stored, types)
        weights.require_same(weights.read(part), stored)
    arrays = [array for each in content.values() for array in each]
    print(f'{options.output}: {len(content)} layers, {sum(a.size for a in arrays)} numbers, the same when read back')


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
            raise CheckFailed(f'check failed: {options.output} holds other numbers than {options.input}')
    print(f'{options.output}: {"x".join(map(str, mean.shape))}, the same when read back')


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
                        help='the size of an input to compare with')
    parser.add_argument('--input', action='append', default=[], metavar='[BLOB=]FILE.npy',
                        help='an input to compare with, instead of random numbers')


def _declare_onnx(parser):
    parser.add_argument('prototxt', metavar='PROTOTXT')
    parser.add_argument('weights', metavar='WEIGHTS', nargs='?', help='caffemodel, .h5 or .npz')
    parser.add_argument('output', metavar='OUT.onnx')
    parser.add_argument('--end', metavar='LAYER', help='cut the net off after this layer')
    parser.add_argument('--graft', metavar='LAYER', help='append a copy of this layer, which has no weights, after --end with its normalisation and ReLU')
    parser.add_argument('--fixed', action='store_true', help='the sizes of the example are the only ones (default: any sizes)')
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
    parser.add_argument('--bgr', action='store_true', help='for pictures in the order blue, green, red, as Caffe has them')
    parser.add_argument('--input-shape', metavar='NxCxHxW', help='the input size to write into the prototxt')
    _check_options(parser)


def _declare_matconvnet(parser):
    parser.add_argument('mat', metavar='FILE.mat')
    _to_caffe(parser)
    parser.add_argument('--mean', metavar='FILE', help='also write the average image: .npy or .binaryproto')


def _run_matconvnet(options):
    from . import to_caffe, weights
    weights.kind_of(options.out_weights)
    if options.mean and Path(options.mean).suffix.lower() not in ('.npy', '.binaryproto'):
        raise UsageError(f'{options.mean}: the name must end in .npy or .binaryproto')
    files.may_write(options.force, *filter(None, (options.out_prototxt, options.out_weights, options.mean)))
    to_caffe.matconvnet(options)


def _declare_torch(parser):
    parser.add_argument('architecture', metavar='NAME', help='as in torchvision.models: alexnet, vgg16, resnet50, ...')
    parser.add_argument('state', metavar='STATE', help='the state dict: .pth, .pt, .safetensors or .npz')
    _to_caffe(parser)
    parser.add_argument('--transform-input', action='store_true',
                        help='googlenet: with what torchvision does to the input of its own trained weights')


def _run_torch(options):
    from . import to_caffe, weights
    weights.kind_of(options.out_weights)
    files.may_write(options.force, options.out_prototxt, options.out_weights)
    to_caffe.torch(options)


COMMANDS = {
    'weights': Command(
        'weights between caffemodel, HDF5 and npz',
        "Write weights in another format. HDF5 is as Caffe writes it: /data/LAYER/INDEX; the keys of npz are LAYER/INDEX. Files of "
        "before 2015 are brought into the current format. A prototxt is: 'revisit net upgrade old.prototxt new.prototxt'.",
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
        'BatchNorm and Scale into the layer before',
        'Write a network whose BatchNorm layers, with the Scale layers after them, are in the weights of the Convolution or '
        'InnerProduct layers before them. Compares both networks.',
        '  revisit-convert fold deploy.prototxt model.caffemodel folded.prototxt folded.caffemodel\n',
        _declare_fold, _run_fold),
    'onnx': Command(
        'a Caffe network as an ONNX model',
        'Write a network for ONNX Runtime and others (opset 17). Compares ONNX Runtime with the engine of revisit on the same input, '
        'and once more at another size. A net that ends in DetectionOutput (SSD) is written up to it, which a note says.',
        '  revisit-convert onnx deploy.prototxt model.caffemodel model.onnx\n'
        '  revisit-convert onnx deploy.prototxt model.caffemodel front.onnx --end conv3 --graft pool5 --input-shape 1x3x107x400\n'
        '  revisit-convert onnx deploy.prototxt model.npz half.onnx --float16\n',
        _declare_onnx, _run_onnx),
    'torch': Command(
        'networks of torchvision as Caffe networks',
        'Write a network of torchvision (AlexNet, VGG, SqueezeNet, ResNet, ResNeXt, MobileNet v2, GoogLeNet) from its state dict. '
        'Compares PyTorch with the engine of revisit where PyTorch and torchvision are installed. The network takes what the '
        'original takes: with the weights of torchvision RGB pictures, (x / 255 - mean) / deviation.',
        '  revisit-convert torch resnet50 resnet50.pth resnet50.prototxt resnet50.caffemodel\n'
        '  revisit-convert torch vgg16 vgg16.safetensors vgg16.prototxt vgg16.caffemodel --bgr\n',
        _declare_torch, _run_torch),
    'matconvnet': Command(
        'networks of MatConvNet as Caffe networks',
        'Write a SimpleNN network of MatConvNet, such as imagenet-vgg-f.mat. Compares what MatConvNet computes, in NumPy, with the '
        'engine of revisit. The networks of its site take RGB pictures less the average image, in 0 to 255.',
        '  revisit-convert matconvnet imagenet-vgg-s.mat vgg_s.prototxt vgg_s.caffemodel --bgr --mean vgg_s_mean.npy\n',
        _declare_matconvnet, _run_matconvnet),
}
