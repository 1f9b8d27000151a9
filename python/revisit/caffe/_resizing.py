"""Resizing and cropping of images."""

import numpy as np


def _line_weights(n_in, n_out):
    """Returns two indices and two weights per pixel of a resized line; weights are 0 outside the line.

    Pixels are areas: the center of pixel i is at i + 0.5.
    """
    place = (np.arange(n_out) + 0.5) * (n_in / n_out) - 0.5
    low = np.floor(place).astype(int)
    fraction = place - low
    inside = lambda index: (index >= 0) & (index < n_in)
    return (
        np.clip(low, 0, n_in - 1),
        np.clip(low + 1, 0, n_in - 1),
        (1 - fraction) * inside(low),
        fraction * inside(low + 1),
    )


def _corner_weights(n_in, n_out):
    """Like _line_weights(), with fixed first and last pixels."""
    place = np.arange(n_out) * ((n_in - 1) / (n_out - 1) if n_out > 1 else 0)
    low = np.minimum(place.astype(int), max(n_in - 2, 0))
    fraction = place - low
    return low, np.minimum(low + 1, n_in - 1), 1 - fraction, fraction


def _resampled(image, size, weights):
    rows, columns = weights(image.shape[0], size[0]), weights(image.shape[1], size[1])
    low, high, a, b = columns
    image = image[:, low] * a[:, np.newaxis] + image[:, high] * b[:, np.newaxis]
    low, high, a, b = rows
    return image[low] * a[:, np.newaxis, np.newaxis] + image[high] * b[:, np.newaxis, np.newaxis]


def _nearest_corner(image, size):
    """Nearest-neighbor version of _corner_weights(); ties go to the second pixel."""
    rows, columns = (
        np.floor(np.arange(n_out) * ((n_in - 1) / (n_out - 1) if n_out > 1 else 0) + 0.5).astype(int)
        for n_in, n_out in zip(image.shape, size)
    )
    return image[rows][:, columns]


def _nearest(image, size):
    rows, columns = (
        np.clip(np.rint((np.arange(n_out) + 0.5) * (n_in / n_out) - 0.5).astype(int), 0, n_in - 1)
        for n_in, n_out in zip(image.shape, size)
    )
    return image[rows][:, columns]


def _by_splines(image, size, order, **mode):
    try:
        from scipy.ndimage import zoom
    except ImportError as error:
        raise ImportError(
            f'resize_image() with interp_order={order} needs the package scipy: pip install scipy (orders 0 and 1 do not)'
        ) from error
    scale = (size[0] / image.shape[0], size[1] / image.shape[1], 1)
    return zoom(image, scale, order=order, **mode)


def _with_corners(image, size, order):
    if order == 0:
        return _nearest_corner(image, size)
    if order == 1:
        return _resampled(image, size, _corner_weights)
    return _by_splines(image, size, order)


def resize_image(im, new_dims, interp_order=1):
    """Resizes an image [h][w][c] to new_dims = (h, w), float32, without antialiasing.

    With 1 or 3 channels, pixels are areas and the image is padded with its minimum, which darkens the edges of an enlarged
    image. With other numbers of channels, corner pixels stay at the corners. Both match pycaffe with the scikit-image of
    its time.
    """
    im = np.asarray(im)
    size = (int(new_dims[0]), int(new_dims[1]))
    if im.ndim != 3 or 0 in im.shape or min(size) < 1:
        raise ValueError(f'resize_image: expected an image of 3 axes and a size of at least 1 x 1, found {im.shape} and {size}')
    if im.shape[2] not in (1, 3):
        return _with_corners(im.astype(float), size, interp_order).astype(np.float32)
    low, high = float(im.min()), float(im.max())
    if high <= low:
        return np.full((*size, im.shape[2]), low, np.float32)
    image = (im.astype(float) - low) / (high - low)
    if interp_order == 0:
        image = _nearest(image, size)
    elif interp_order == 1:
        image = _resampled(image, size, _line_weights)
    else:
        image = _by_splines(image, size, interp_order, mode='grid-constant', grid_mode=True)
        image = np.clip(image, 0, 1)
    return (image * (high - low) + low).astype(np.float32)


def oversample(images, crop_dims):
    """Returns ten crops per image [h][w][c]: four corners and center, and their mirror images; [10 n][h][w][c].

    Args:
        images: must have one size.
        crop_dims: (h, w) of the crops.
    """
    crop_h, crop_w = (int(size) for size in crop_dims)
    h, w = images[0].shape[:2]
    if crop_h > h or crop_w > w:
        raise ValueError(f'oversample: expected crops of at most {h} x {w} (the image), found {crop_h} x {crop_w}')
    begins = [(y, x) for y in (0, h - crop_h) for x in (0, w - crop_w)]
    begins.append((int(h / 2 - crop_h / 2), int(w / 2 - crop_w / 2)))
    crops = []
    for image in images:
        upright = [image[y : y + crop_h, x : x + crop_w] for y, x in begins]
        crops += upright + [crop[:, ::-1] for crop in upright]
    return np.array(crops, np.float32)
