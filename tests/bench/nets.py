"""Descriptions of published networks as prototxt text, at any input size, up to the layer compared."""


class Net:
    """Layers one behind the other; `last` is the blob that the next one reads."""

    def __init__(self, name, n, c, h, w):
        self.text = f'name: "{name}"\n'
        self.last = 'data'
        self.text += (f'layer {{ name: "data" type: "Input" top: "data"\n'
                      f'  input_param {{ shape {{ dim: {n} dim: {c} dim: {h} dim: {w} }} }} }}\n')

    def layer(self, kind, name, param='', bottoms=None, top=None):
        bottoms = bottoms or [self.last]
        self.last = top or name
        inputs = ' '.join(f'bottom: "{b}"' for b in bottoms)
        self.text += f'layer {{ name: "{name}" type: "{kind}" {inputs} top: "{self.last}" {param} }}\n'
        return self.last

    def conv(self, name, outputs, kernel, stride=1, pad=0, group=1, bias=True, bottom=None):
        param = f'num_output: {outputs} kernel_size: {kernel} stride: {stride} pad: {pad} group: {group}'
        if not bias:
            param += ' bias_term: false'
        return self.layer('Convolution', name, f'convolution_param {{ {param} }}',
                          [bottom or self.last])

    def relu(self):
        return self.layer('ReLU', self.last + '_relu', top=self.last)

    def conv_relu(self, *args, **keys):
        self.conv(*args, **keys)
        return self.relu()

    def lrn(self, name, alpha, k):
        return self.layer('LRN', name,
                          f'lrn_param {{ local_size: 5 alpha: {alpha} beta: 0.75 k: {k} }}')

    def pool(self, name, kernel, stride, kind='MAX', pad=0):
        return self.layer('Pooling', name, f'pooling_param {{ pool: {kind} kernel_size: {kernel} '
                                           f'stride: {stride} pad: {pad} }}')


def alexnet(n, c, h, w):
    """Krizhevsky et al. 2012, conv3 and pool5: the paper's best."""
    net = Net('alexnet_conv3_pool5', n, c, h, w)
    net.conv_relu('conv1', 96, 11, 4)
    net.lrn('norm1', 1e-4, 1)
    net.pool('pool1', 3, 2)
    net.conv_relu('conv2', 256, 5, 1, 2, 2)
    net.lrn('norm2', 1e-4, 1)
    net.pool('pool2', 3, 2)
    net.conv_relu('conv3', 384, 3, 1, 1)
    net.pool('pool5', 3, 2)
    return net.text


def vgg_cnn_s(n, c, h, w):
    """Chatfield et al. 2014, conv4 and pool5."""
    net = Net('vgg_cnn_s_conv4_pool5', n, c, h, w)
    net.conv_relu('conv1', 96, 7, 2)
    net.lrn('norm1', 5e-4, 2)
    net.pool('pool1', 3, 3)
    net.conv_relu('conv2', 256, 5)
    net.pool('pool2', 2, 2)
    net.conv_relu('conv3', 512, 3, 1, 1)
    net.conv_relu('conv4', 512, 3, 1, 1)
    net.pool('pool5', 3, 3)
    return net.text


def places_cnds8(n, c, h, w):
    """Wang et al. 2015, to pool5."""
    net = Net('places_cnds8_pool5', n, c, h, w)
    net.conv_relu('conv1', 64, 7, 2, 1)
    net.pool('pool1', 3, 2)
    net.conv_relu('conv2', 128, 3, 1, 1)
    net.pool('pool2', 2, 2)
    for stage, outputs in ((3, 256), (4, 512), (5, 512)):
        net.conv_relu(f'conv{stage}_1', outputs, 3, 1, 1)
        net.conv_relu(f'conv{stage}_2', outputs, 3, 1, 1)
        net.pool(f'pool{stage}', 2, 2)
    return net.text


def squeezenet(n, c, h, w):
    """Iandola et al. 2016, version 1.0, to fire8."""
    net = Net('squeezenet_v1.0_fire8', n, c, h, w)
    net.conv_relu('conv1', 96, 7, 2)
    net.pool('pool1', 3, 2)
    for fire, squeeze, expand in ((2, 16, 64), (3, 16, 64), (4, 32, 128), (5, 32, 128),
                                  (6, 48, 192), (7, 48, 192), (8, 64, 256)):
        if fire == 5:
            net.pool('pool4', 3, 2)
        squeezed = net.conv_relu(f'fire{fire}/squeeze1x1', squeeze, 1)
        parts = [net.conv_relu(f'fire{fire}/expand1x1', expand, 1, bottom=squeezed),
                 net.conv_relu(f'fire{fire}/expand3x3', expand, 3, 1, 1, bottom=squeezed)]
        net.layer('Concat', f'fire{fire}/concat', bottoms=parts)
    return net.text


def vgg16(n, c, h, w):
    """Simonyan and Zisserman 2014, to conv5_3 and its ReLU."""
    net = Net('vgg16_conv5_3', n, c, h, w)
    for stage, outputs, count in ((1, 64, 2), (2, 128, 2), (3, 256, 3), (4, 512, 3), (5, 512, 3)):
        for i in range(1, count + 1):
            net.conv_relu(f'conv{stage}_{i}', outputs, 3, 1, 1)
        if stage < 5:
            net.pool(f'pool{stage}', 2, 2)
    return net.text


def resnet50(n, c, h, w):
    """He et al. 2015: the whole classifier where its last pooling fits, else to res5c."""
    net = Net('resnet50', n, c, h, w)

    def conv_bn(name, outputs, kernel, stride=1, pad=0, bottom=None, relu=True):
        net.conv('res' + name, outputs, kernel, stride, pad, bias=False, bottom=bottom)
        net.layer('BatchNorm', 'bn' + name, 'batch_norm_param { use_global_stats: true }',
                  top=net.last)
        net.layer('Scale', 'scale' + name, 'scale_param { bias_term: true }', top=net.last)
        return net.relu() if relu else net.last

    conv_bn('1', 64, 7, 2, 3)
    net.pool('pool1', 3, 2)
    for stage, width, count in ((2, 64, 3), (3, 128, 4), (4, 256, 6), (5, 512, 3)):
        for i in range(count):
            block = f'{stage}{"abcdef"[i]}'
            start = net.last
            stride = 2 if i == 0 and stage > 2 else 1
            shortcut = start
            if i == 0:
                shortcut = conv_bn(f'{block}_branch1', 4 * width, 1, stride, bottom=start, relu=False)
            conv_bn(f'{block}_branch2a', width, 1, stride, bottom=start)
            conv_bn(f'{block}_branch2b', width, 3, 1, 1)
            branch = conv_bn(f'{block}_branch2c', 4 * width, 1, relu=False)
            net.layer('Eltwise', f'res{block}', bottoms=[shortcut, branch])
            net.relu()
    if h == w == 224:
        net.pool('pool5', 7, 1, 'AVE')
        net.layer('InnerProduct', 'fc1000', 'inner_product_param { num_output: 1000 }')
        net.layer('Softmax', 'prob')
    return net.text


NETS = {'alexnet': alexnet, 'vgg_cnn_s': vgg_cnn_s, 'places_cnds8': places_cnds8,
        'squeezenet': squeezenet, 'vgg16': vgg16, 'resnet50': resnet50}
