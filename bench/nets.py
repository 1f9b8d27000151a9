"""Prototxts of published networks for any input size, truncated to the compared layer."""

import re
from pathlib import Path


class Net:
    """A chain of layers; the next layer reads the blob `last`."""

    def __init__(self, name, n, c, h, w):
        self.last = 'data'
        self.text = (f'name: "{name}"\nlayer {{ name: "data" type: "Input" top: "data"\n'
                     f'  input_param {{ shape {{ dim: {n} dim: {c} dim: {h} dim: {w} }} }} }}\n')

    def layer(self, kind, name, param='', bottoms=None, top=None):
        bottoms = bottoms or [self.last]
        self.last = top or name
        inputs = ' '.join(f'bottom: "{b}"' for b in bottoms)
        self.text += f'layer {{ name: "{name}" type: "{kind}" {inputs} top: "{self.last}" {param} }}\n'
        return self.last

    def conv(self, name, outputs, kernel, stride=1, pad=0, group=1, bias=True, bottom=None):
        param = f'num_output: {outputs} kernel_size: {kernel} stride: {stride} pad: {pad} group: {group}' + ' bias_term: false' * (not bias)
        return self.layer('Convolution', name, f'convolution_param {{ {param} }}', [bottom or self.last])

    def relu(self):
        return self.layer('ReLU', self.last + '_relu', top=self.last)

    def conv_relu(self, *args, **keys):
        self.conv(*args, **keys)
        return self.relu()

    def lrn(self, name, alpha, k):
        return self.layer('LRN', name, f'lrn_param {{ local_size: 5 alpha: {alpha} beta: 0.75 k: {k} }}')

    def pool(self, name, kernel, stride, kind='MAX', pad=0):
        return self.layer('Pooling', name, f'pooling_param {{ pool: {kind} kernel_size: {kernel} stride: {stride} pad: {pad} }}')


def own_net(name, size, skipped=()):
    """A net of this project, which ends with pool5. pool5 reads the last layer before the skipped ones."""
    net = Net(name, *size)
    text = (Path(__file__).parents[1] / f'weights_conversion/nets/{name}.prototxt').read_text()
    for layer in re.findall(r'^layer \{.*?^\}\n', text, re.M | re.S)[1:]:
        if re.search(r'top: "(\w+)"', layer)[1] not in skipped:
            net.text += re.sub(r'bottom: "\w+"', f'bottom: "{net.last}"', layer)
            net.last = re.search(r'top: "(\w+)"', layer)[1]
    return net


def fire(net, number, squeeze, expand):
    squeezed = net.conv_relu(f'fire{number}/squeeze1x1', squeeze, 1)
    parts = [net.conv_relu(f'fire{number}/expand1x1', expand, 1, bottom=squeezed),
             net.conv_relu(f'fire{number}/expand3x3', expand, 3, 1, 1, bottom=squeezed)]
    net.layer('Concat', f'fire{number}/concat', bottoms=parts)


def fires(net, last, pooled):
    """Modules fire2 to fire`last`, with a pooling before those of `pooled`."""
    for number, squeeze, expand in ((2, 16, 64), (3, 16, 64), (4, 32, 128), (5, 32, 128), (6, 48, 192), (7, 48, 192), (8, 64, 256),
                                    (9, 64, 256))[:last - 1]:
        if number in pooled:
            net.pool(f'pool{number - 1}', 3, 2)
        fire(net, number, squeeze, expand)


def squeezenet(n, c, h, w):
    """Iandola et al. 2016, version 1.0, to fire8."""
    net = Net('squeezenet_v1.0_fire8', n, c, h, w)
    net.conv_relu('conv1', 96, 7, 2)
    fires(net, 8, (2, 5))
    return net.text


def vgg16_to_conv5_3(name, n, c, h, w):
    net = Net(name, n, c, h, w)
    for stage, outputs, count in ((1, 64, 2), (2, 128, 2), (3, 256, 3), (4, 512, 3), (5, 512, 3)):
        for i in range(1, count + 1):
            net.conv_relu(f'conv{stage}_{i}', outputs, 3, 1, 1)
        if stage < 5:
            net.pool(f'pool{stage}', 2, 2)
    return net


def resnet50(n, c, h, w):
    """He et al. 2015: the full net if its last pooling fits, else to res5c."""
    net = Net('resnet50', n, c, h, w)

    def conv_bn(name, outputs, kernel, stride=1, pad=0, bottom=None, relu=True):
        net.conv('res' + name, outputs, kernel, stride, pad, bias=False, bottom=bottom)
        net.layer('BatchNorm', 'bn' + name, 'batch_norm_param { use_global_stats: true }', top=net.last)
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


def classifier(net, hidden=()):
    for i, outputs in enumerate(hidden):
        net.layer('InnerProduct', f'fc{i + 6}', f'inner_product_param {{ num_output: {outputs} }}')
        net.relu()
    net.layer('InnerProduct', 'classes', 'inner_product_param { num_output: 1000 }')
    net.layer('Softmax', 'prob')
    return net.text


def global_pool(net):
    return net.layer('Pooling', 'pool_global', 'pooling_param { pool: AVE global_pooling: true }')


def whole_vgg16(n, c, h, w):
    """Simonyan and Zisserman 2014, the full net."""
    net = vgg16_to_conv5_3('vgg16', n, c, h, w)
    net.pool('pool5', 2, 2)
    return classifier(net, (4096, 4096))


def googlenet(n, c, h, w):
    """Szegedy et al. 2014, the full net."""
    net = Net('googlenet', n, c, h, w)

    def inception(name, a, b1, b2, c1, c2, d):
        start = net.last
        parts = [net.conv_relu(name + '/1x1', a, 1)]
        net.conv_relu(name + '/3x3_reduce', b1, 1, bottom=start)
        parts.append(net.conv_relu(name + '/3x3', b2, 3, 1, 1))
        net.conv_relu(name + '/5x5_reduce', c1, 1, bottom=start)
        parts.append(net.conv_relu(name + '/5x5', c2, 5, 1, 2))
        net.last = start
        net.pool(name + '/pool', 3, 1, pad=1)
        parts.append(net.conv_relu(name + '/pool_proj', d, 1))
        net.layer('Concat', name + '/output', bottoms=parts)

    net.conv_relu('conv1', 64, 7, 2, 3)
    net.pool('pool1', 3, 2)
    net.lrn('norm1', 1e-4, 1)
    net.conv_relu('conv2_reduce', 64, 1)
    net.conv_relu('conv2', 192, 3, 1, 1)
    net.lrn('norm2', 1e-4, 1)
    net.pool('pool2', 3, 2)
    inception('3a', 64, 96, 128, 16, 32, 32)
    inception('3b', 128, 128, 192, 32, 96, 64)
    net.pool('pool3', 3, 2)
    inception('4a', 192, 96, 208, 16, 48, 64)
    inception('4b', 160, 112, 224, 24, 64, 64)
    inception('4c', 128, 128, 256, 24, 64, 64)
    inception('4d', 112, 144, 288, 32, 64, 64)
    inception('4e', 256, 160, 320, 32, 128, 128)
    net.pool('pool4', 3, 2)
    inception('5a', 256, 160, 320, 32, 128, 128)
    inception('5b', 384, 192, 384, 48, 128, 128)
    global_pool(net)
    return classifier(net)


def whole_squeezenet(n, c, h, w):
    """Iandola et al. 2016, version 1.1, the full net."""
    net = Net('squeezenet_v1.1', n, c, h, w)
    net.conv_relu('conv1', 64, 3, 2)
    fires(net, 9, (2, 4, 6))
    net.conv_relu('conv10', 1000, 1)
    global_pool(net)
    net.layer('Softmax', 'prob')
    return net.text


def mobilenet_v1(n, c, h, w):
    """Howard et al. 2017, the full net."""
    net = Net('mobilenet_v1', n, c, h, w)
    net.conv_relu('conv1', 32, 3, 2, 1)
    channels = 32
    for i, (outputs, stride) in enumerate(((64, 1), (128, 2), (128, 1), (256, 2), (256, 1), (512, 2))
                                          + ((512, 1),) * 5 + ((1024, 2), (1024, 1))):
        net.conv_relu(f'conv{i + 2}/dw', channels, 3, stride, 1, channels)
        net.conv_relu(f'conv{i + 2}/sep', outputs, 1)
        channels = outputs
    global_pool(net)
    return classifier(net)


def mobilenet_v2(n, c, h, w):
    """Sandler et al. 2018, the full net."""
    net = Net('mobilenet_v2', n, c, h, w)

    def conv_relu6(*args, **keys):
        net.conv(*args, **keys)
        return net.layer('ReLU6', net.last + '_relu', top=net.last)

    conv_relu6('conv1', 32, 3, 2, 1)
    channels, block = 32, 0
    for expansion, outputs, count, stride in ((1, 16, 1, 1), (6, 24, 2, 2), (6, 32, 3, 2), (6, 64, 4, 2),
                                              (6, 96, 3, 1), (6, 160, 3, 2), (6, 320, 1, 1)):
        for i in range(count):
            start, inner = net.last, channels * expansion
            if expansion > 1:
                conv_relu6(f'block{block}/expand', inner, 1)
            conv_relu6(f'block{block}/dw', inner, 3, stride if i == 0 else 1, 1, inner)
            net.conv(f'block{block}/linear', outputs, 1)
            if i > 0:
                net.layer('Eltwise', f'block{block}', bottoms=[start, net.last])
            channels, block = outputs, block + 1
    conv_relu6('conv_last', 1280, 1)
    global_pool(net)
    return classifier(net)


NETS = {'alexnet': lambda *size: own_net('alexnet', size, ('conv4', 'conv5')).text,  # conv3 and pool5, the best in the paper
        'vgg_cnn_s': lambda *size: own_net('vgg_cnn_s', size, ('conv5',)).text,
        'places_cnds8': lambda *size: own_net('places_cnds8', size).text,
        'vgg16': lambda *size: vgg16_to_conv5_3('vgg16_conv5_3', *size).text,  # Simonyan and Zisserman 2014, with its ReLU
        'squeezenet': squeezenet, 'resnet50': resnet50,
        'whole_alexnet': lambda *size: classifier(own_net('alexnet', size), (4096, 4096)),
        'whole_vgg16': whole_vgg16, 'googlenet': googlenet,
        'whole_squeezenet': whole_squeezenet, 'mobilenet_v1': mobilenet_v1,
        'mobilenet_v2': mobilenet_v2}
