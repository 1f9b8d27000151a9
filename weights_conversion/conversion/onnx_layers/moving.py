"""Layers that move, select and repeat values."""

from ..onnx_builder import INT_MAX


def _concat(g, site):
    p = site.message.concat_param
    return [g.node('Concat', *site.x, axis=p.concat_dim if p.HasField('concat_dim') else p.axis)]


def _slice(g, site):
    p = site.message.slice_param
    axis, n = p.slice_dim if p.HasField('slice_dim') else p.axis, len(site.layer.outputs)
    if n == 1:
        return [site.x[0]]
    if not p.slice_point:
        return g.node('Split', site.x[0], axis=axis, n_outputs=n)
    edges = [0, *p.slice_point, INT_MAX]
    return [g.node('Slice', site.x[0], g.integers(begin), g.integers(end), g.integers(axis))
            for begin, end in zip(edges, edges[1:])]


def _flatten(g, site):
    p, rank = site.message.flatten_param, len(site.shapes[0])
    first, last = site.axis(p.axis), site.axis(p.end_axis)
    rest = [g.shape(site.x[0], last + 1)] if last + 1 < rank else []
    return [g.reshape(site.x[0], *[0] * first, -1, *rest)]


def _squeeze(g, site):
    p, shape = site.message.squeeze_param, site.shapes[0]
    if not p.axis:
        site.require_fixed('without an axis the result depends on')
    axes = [site.axis(axis) for axis in p.axis] or [i for i, size in enumerate(shape) if size == 1]
    return [g.node('Squeeze', site.x[0], g.integers(*sorted(set(axes))))] if axes else [g.node('Identity', site.x[0])]


def _reshape(g, site):
    p, rank = site.message.reshape_param, len(site.shapes[0])
    first = p.axis if p.axis >= 0 else rank + p.axis + 1  # -1 is the position after the last axis
    last = rank if p.num_axes == -1 else first + p.num_axes
    rest = [g.shape(site.x[0], last)] if last < rank else []
    return [g.reshape(site.x[0], *[0] * first, *[int(size) for size in p.shape.dim], *rest)]


def _in_order(g, site, order):
    if order == sorted(order):  # ONNX Runtime 1.22 would fuse an identity Transpose incorrectly with Gemm
        return [site.x[0]]
    return [g.node('Transpose', site.x[0], perm=order)]


def _permute(g, site):
    order = list(site.message.permute_param.order)
    return _in_order(g, site, order + [axis for axis in range(len(site.shapes[0])) if axis not in order])


def _transpose(g, site):
    return _in_order(g, site, list(site.message.transpose_param.dim))


def _reversed(g, x, axes):
    n = len(axes)
    return g.node('Slice', x, g.integers(*[-1] * n), g.integers(*[-INT_MAX] * n), g.integers(*axes), g.integers(*[-1] * n))


def _reverse(g, site):
    return [_reversed(g, site.x[0], [site.axis(axis) for axis in site.message.reverse_param.axis or [0]])]


def _flip(g, site):
    p, rank = site.message.flip_param, len(site.shapes[0])
    axes = [axis for axis, flips in ((2, p.flip_height), (3, p.flip_width)) if flips and axis < rank]
    return [_reversed(g, site.x[0], axes) if axes else site.x[0]]


def _reorg(g, site):
    """Without `reverse`, Darknet interprets input and result as having fewer channels and larger maps."""
    p, x = site.message.reorg_param, site.x[0]
    stride, size = g.integers(p.stride), g.shape(x, 2)
    if p.reverse:
        return [g.node('DepthToSpace', x, blocksize=p.stride)]
    large = g.reshape(x, 0, -1, g.node('Mul', size, stride))
    return [g.reshape(g.node('SpaceToDepth', large, blocksize=p.stride), 0, -1, g.node('Div', size, stride))]


def _depth_to_space(g, site):
    p = site.message.depth_to_space_param
    return [g.node('DepthToSpace', site.x[0], blocksize=p.block_size, mode='CRD' if p.data_format == 'CRD' else 'DCR')]


def _tile(g, site):
    p = site.message.tile_param
    repeats = [g.integers(1)] * len(site.shapes[0])
    repeats[p.axis] = g.shape(site.x[1], 0, 1) if len(site.x) == 2 and site.shapes[1] else g.integers(p.tiles)
    return [g.node('Tile', site.x[0], g.node('Concat', *repeats, axis=0))]


def _crop(g, site):
    p, rank = site.message.crop_param, len(site.shapes[0])
    first = site.axis(p.axis)
    offsets = list(p.offset) or [0]
    if len(offsets) == 1:
        offsets *= rank - first
    begin = g.integers(*offsets)
    end = g.node('Add', begin, g.shape(site.x[1], first, rank))
    return [g.node('Slice', site.x[0], begin, end, g.integers(*range(first, rank)))]


def _crop_center(g, site):
    cut = site.message.crop_center_param.crop_size
    ends = [-size if size else INT_MAX for size in cut]
    return [g.node('Slice', site.x[0], g.integers(*cut), g.integers(*ends), g.integers(*range(len(cut))))]


def _shuffle_channel(g, site):
    rank = len(site.shapes[0])
    rest = [g.shape(site.x[0], 2)] if rank > 2 else []
    split = g.reshape(site.x[0], 0, site.message.shuffle_channel_param.group, -1, *rest)
    return [g.reshape(g.node('Transpose', split, perm=[0, 2, 1, *range(3, rank + 1)]), g.shape(site.x[0]))]


def _batch_reindex(g, site):
    return [g.node('Gather', site.x[0], g.to_integers(site.x[1]), axis=0)]


def _filter(g, site):
    chosen = g.node('Not', g.node('Equal', g.reshape(site.x[-1], -1), g.constant(0)))
    return [g.node('Compress', x, chosen, axis=0) for x in site.x[:-1]]


def _embed(g, site):
    p = site.message.embed_param
    table = g.constant(site.blobs[0].reshape(p.input_dim, p.num_output))
    y = g.node('Gather', table, g.to_integers(site.x[0]), axis=0)
    return [g.node('Add', y, g.constant(site.blobs[1].ravel())) if p.bias_term else y]


def _argmax(g, site):
    """Reverses the values before TopK, because among equal values Caffe prefers the last and TopK the first."""
    p, shape = site.message.argmax_param, site.shapes[0]
    k = g.integers(p.top_k)
    axis = site.axis(p.axis) if p.HasField('axis') else 1
    line = site.x[0] if p.HasField('axis') else g.node('Flatten', site.x[0], axis=1)
    values, places = g.node('TopK', _reversed(g, line, [axis]), k, axis=axis, n_outputs=2)
    last = g.node('Sub', g.shape(line, axis, axis + 1), g.integers(1))
    indices = g.to_float(g.node('Sub', last, places))
    if p.HasField('axis'):
        return [values if p.out_max_val else indices]
    parts = [indices, values] if p.out_max_val else [indices]
    shaped = [g.reshape(part, 0, 1, p.top_k, *[1] * (len(shape) - 3)) for part in parts]
    return [g.node('Concat', *shaped, axis=1) if len(shaped) > 1 else shaped[0]]


def _interp(g, site):
    p = site.message.interp_param
    x = site.x[0]
    if p.pad_beg or p.pad_end:  # negative: they crop
        x = g.node('Slice', x, g.integers(-p.pad_beg, -p.pad_beg), g.integers(*[p.pad_end or INT_MAX] * 2),
                   g.integers(2, 3))
    if p.HasField('height') and p.HasField('width') and p.HasField('shrink_factor') == p.HasField('zoom_factor'):
        size = g.integers(p.height, p.width)
    else:
        one = g.integers(1)
        steps = g.node('Div', g.node('Sub', g.shape(x, 2, 4), one), g.integers(p.shrink_factor))
        size = g.node('Add', g.node('Mul', steps, g.integers(p.zoom_factor)), one)
    sizes = g.node('Concat', g.shape(x, 0, 2), size, axis=0)
    return [g.node('Resize', x, '', '', sizes, mode='linear', coordinate_transformation_mode='align_corners')]


def _upsample(g, site):
    p = site.message.upsample_param
    if len(site.x) == 1:
        return [g.node('Resize', site.x[0], '', g.constant([1, 1, p.scale, p.scale]), mode='nearest',
                       coordinate_transformation_mode='asymmetric', nearest_mode='floor')]
    lead = g.shape(site.x[0], 0, 2)
    if p.HasField('upsample_h') and p.HasField('upsample_w'):
        site.require_fixed('upsample_h and upsample_w depend on')
        size = g.integers(p.upsample_h, p.upsample_w)
    else:
        hw = p.HasField('scale_h') or p.HasField('scale_w')
        scale = g.integers(*((p.scale_h, p.scale_w) if hw else (p.scale, p.scale)))
        size = g.node('Sub', g.node('Mul', g.shape(site.x[0], 2, 4), scale), g.integers(p.pad_out_h, p.pad_out_w))
    pixels = g.node('ReduceProd', size, axes=[0], keepdims=1)
    empty = g.node('ConstantOfShape', g.node('Concat', lead, pixels, axis=0))
    mask, channels = site.x[1], site.shapes[0][1]
    if site.shapes[1][1] > channels:
        mask = g.node('Slice', mask, g.integers(0), g.integers(channels), g.integers(1))
    places = g.to_integers(g.reshape(mask, 0, 0, -1))
    flat = g.node('ScatterElements', empty, places, g.reshape(site.x[0], 0, 0, -1), axis=2)
    return [g.reshape(flat, lead, size)]


def _parameter(g, site):
    return [g.constant(site.blobs[0].reshape(site.results[0].shape))]


def _constants(g, site):
    return [g.constant(result) for result in site.results]


def _prior_box(g, site):
    site.require_fixed('boxes depend on')
    return _constants(g, site)


EMIT = {
    'ArgMax': _argmax, 'BatchReindex': _batch_reindex, 'Concat': _concat, 'Crop': _crop, 'CropCenter': _crop_center,
    'DepthToSpace': _depth_to_space, 'DummyData': _constants, 'Embed': _embed, 'Filter': _filter, 'Flatten': _flatten, 'Flip': _flip,
    'Interp': _interp, 'Parameter': _parameter, 'Permute': _permute, 'PriorBox': _prior_box, 'PriorBoxClustered': _prior_box, 'Reorg': _reorg,
    'Reshape': _reshape, 'Reverse': _reverse, 'ShuffleChannel': _shuffle_channel, 'Slice': _slice, 'Squeeze': _squeeze, 'Tile': _tile,
    'Transpose': _transpose, 'Upsample': _upsample,
}
