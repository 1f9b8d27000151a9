#!/usr/bin/env python3
"""Classifies an image with a Caffe network and prints the most probable classes.

  classify_image.py deploy.prototxt model.caffemodel cat.jpg --labels synset_words.txt --mean 104,117,123
"""

import argparse
from pathlib import Path

import numpy as np

import revisit


def read_image(file, height, width):
    """Returns float32 [h][w][3] in BGR, 0 to 255, as usual in Caffe. A .npy file must have RGB of this size."""
    if Path(file).suffix == '.npy':
        rgb = np.load(file)
    else:
        from PIL import Image  # pip install pillow
        rgb = np.asarray(Image.open(file).convert('RGB').resize((width, height)))
    if rgb.shape != (height, width, 3):
        raise SystemExit(f'{file}: expected {height} x {width} x 3, found {rgb.shape}')
    return rgb[:, :, ::-1].astype(np.float32)


def mean_of(text):
    """Returns the mean as B, G, R: from text, or averaged over a .binaryproto."""
    if Path(text).is_file():
        return revisit.proto.read_binaryproto(text).mean(axis=(-2, -1)).ravel()
    return np.array([float(value) for value in text.split(',')], np.float32)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('prototxt')
    parser.add_argument('weights')
    parser.add_argument('image')
    parser.add_argument('--labels', help='file with one line per class')
    parser.add_argument('--mean', default='104.007,116.669,122.679', help='B,G,R or a .binaryproto (default: %(default)s)')
    parser.add_argument('--top', type=int, default=5)
    parser.add_argument('--threads', type=int, default=1)
    o = parser.parse_args()

    net = revisit.engine.Net.load(o.prototxt, o.weights)
    data, shape = next(iter(net.inputs.items()))
    _, _, height, width = shape
    run = net.plan({data: (1, 3, height, width)}, threads=o.threads).run()

    image = read_image(o.image, height, width) - mean_of(o.mean)
    run.forward({data: image.transpose(2, 0, 1)[None]})  # [1][3][h][w]
    probabilities = run.output(net.outputs[-1]).ravel()

    labels = Path(o.labels).read_text().splitlines() if o.labels else None
    for c in np.argsort(-probabilities, kind='stable')[:o.top]:
        print(f'{probabilities[c]:.4f}  {labels[c] if labels else f"class {c}"}')


if __name__ == '__main__':
    try:
        main()
    except revisit.Error as error:
        raise SystemExit(f'classify_image: {error}')
