"""Images of other sizes, and parts of images."""

import numpy as np


def _line_weights(n_in, n_out):
    """Where the pixels of a resized line lie in the line: two indices and two weights each; 0 beyond its ends.

    Pixels are areas: the middle of pixel i is at i + 0.5.
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
    """The same for lines whose first and last pixels stay where they are."""
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
    """As _corner_weights(); a place in the middle of two pixels is the second's."""
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
    """An image [h][w][c] resized to new_dims = (h, w), float32. Nothing is blurred before an image is made smaller.

    With 1 or 3 channels pixels are areas, and beyond the image is its darkest value: that darkens the edge of an
    image that is made larger. With other numbers of channels the corner pixels stay at the corners. Both as pycaffe
    with scikit-image of its time does.
    """
    im = np.asarray(im)
    size = (int(new_dims[0]), int(new_dims[1]))
    if im.ndim != 3 or 0 in im.shape or min(size) < 1:
        raise ValueError(f'expected an image of 3 axes and a size of at least 1 x 1, found {im.shape} and {size}')
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
    """The four corners and the middle of every image, and these mirrored: [10 n][h][w][c] of images [h][w][c].

    Args:
        images: of one size.
        crop_dims: (h, w) of the crops.
    """
    crop_h, crop_w = (int(size) for size in crop_dims)
    h, w = images[0].shape[:2]
    if crop_h > h or crop_w > w:
        raise ValueError(f'crops of {crop_h} x {crop_w} do not fit in images of {h} x {w}')
    begins = [(y, x) for y in (0, h - crop_h) for x in (0, w - crop_w)]
    begins.append((int(h / 2 - crop_h / 2), int(w / 2 - crop_w / 2)))
    crops = []
    for image in images:
        upright = [image[y : y + crop_h, x : x + crop_w] for y, x in begins]
        crops += upright + [crop[:, ::-1] for crop in upright]
    return np.array(crops, np.float32)
