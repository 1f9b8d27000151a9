#include "revisit/weights_conversion/trunks.h"

#include <initializer_list>
#include <utility>

#include "caffe_schema.pb.h"
#include "revisit/base/error.h"
#include "revisit/base/text.h"

namespace revisit::models {
namespace {

struct Convolution {
  uint32_t outputs, kernel;
  uint32_t stride = 1, pad = 0, groups = 1;
};

struct Rectangle {
  uint32_t h, w;
};

class Chain {
 public:
  Chain(const std::string& name, int64_t size) : Chain(name, {1, 3, size, size}) {}
  Chain(const std::string& name, std::initializer_list<int64_t> input) {
    net_.set_name(name);
    auto* layer = net_.add_layer();
    layer->set_name("data");
    layer->set_type("Input");
    layer->add_top("data");
    auto* shape = layer->mutable_input_param()->add_shape();
    for (const int64_t dim : input) shape->add_dim(dim);
  }

  Chain& conv(const std::string& suffix, const Convolution& c) {
    auto* parameters = append("conv" + suffix, "Convolution")->mutable_convolution_param();
    parameters->set_num_output(c.outputs);
    parameters->add_kernel_size(c.kernel);
    if (c.stride != 1) parameters->add_stride(c.stride);
    if (c.pad != 0) parameters->add_pad(c.pad);
    if (c.groups != 1) parameters->set_group(c.groups);
    auto* relu = net_.add_layer();
    relu->set_name("relu" + suffix);
    relu->set_type("ReLU");
    relu->add_bottom(last_);
    relu->add_top(last_);
    return *this;
  }

  Chain& lrn(const std::string& name, float alpha, float k) {
    auto* parameters = append(name, "LRN")->mutable_lrn_param();
    parameters->set_local_size(5);
    parameters->set_alpha(alpha);
    parameters->set_beta(0.75F);
    if (k != 1) parameters->set_k(k);
    return *this;
  }

  Chain& max_pool(const std::string& name, uint32_t kernel, uint32_t stride) {
    auto* parameters = append(name, "Pooling")->mutable_pooling_param();
    parameters->set_pool(caffe::PoolingParameter::MAX);
    parameters->set_kernel_size(kernel);
    parameters->set_stride(stride);
    return *this;
  }

  Chain& conv_and_pool(uint32_t outputs, const Rectangle& kernel, const Rectangle& pooled) {
    conv("1", {.outputs = outputs, .kernel = 0});
    auto* parameters = net_.mutable_layer(net_.layer_size() - 2)->mutable_convolution_param();
    parameters->clear_kernel_size();
    parameters->set_kernel_h(kernel.h);
    parameters->set_kernel_w(kernel.w);
    auto* pooling = append("pool1", "Pooling")->mutable_pooling_param();
    pooling->set_pool(caffe::PoolingParameter::MAX);
    pooling->set_kernel_h(pooled.h);
    pooling->set_kernel_w(pooled.w);
    pooling->set_stride_h(pooled.h);
    pooling->set_stride_w(pooled.w);
    return *this;
  }

  caffe::NetParameter net() { return std::move(net_); }

 private:
  caffe::LayerParameter* append(const std::string& name, const char* type) {
    auto* layer = net_.add_layer();
    layer->set_name(name);
    layer->set_type(type);
    layer->add_bottom(last_);
    layer->add_top(name);
    last_ = name;
    return layer;
  }

  caffe::NetParameter net_;
  std::string last_ = "data";
};

caffe::NetParameter alexnet_end(Chain& chain) {
  return chain.conv("3", {.outputs = 384, .kernel = 3, .pad = 1})
      .conv("4", {.outputs = 384, .kernel = 3, .pad = 1, .groups = 2})
      .conv("5", {.outputs = 256, .kernel = 3, .pad = 1, .groups = 2})
      .max_pool("pool5", 3, 2)
      .net();
}

caffe::NetParameter alexnet() {
  Chain chain("alexnet_trunk", 227);
  chain.conv("1", {.outputs = 96, .kernel = 11, .stride = 4})
      .lrn("norm1", 1e-4F, 1)
      .max_pool("pool1", 3, 2)
      .conv("2", {.outputs = 256, .kernel = 5, .pad = 2, .groups = 2})
      .lrn("norm2", 1e-4F, 1)
      .max_pool("pool2", 3, 2);
  return alexnet_end(chain);
}

caffe::NetParameter caffenet() {
  Chain chain("caffenet_trunk", 227);
  chain.conv("1", {.outputs = 96, .kernel = 11, .stride = 4})
      .max_pool("pool1", 3, 2)
      .lrn("norm1", 1e-4F, 1)
      .conv("2", {.outputs = 256, .kernel = 5, .pad = 2, .groups = 2})
      .max_pool("pool2", 3, 2)
      .lrn("norm2", 1e-4F, 1);
  return alexnet_end(chain);
}

caffe::NetParameter vgg_cnn_s() {
  Chain chain("vgg_cnn_s_trunk", 224);
  return chain.conv("1", {.outputs = 96, .kernel = 7, .stride = 2})
      .lrn("norm1", 5e-4F, 2)
      .max_pool("pool1", 3, 3)
      .conv("2", {.outputs = 256, .kernel = 5})
      .max_pool("pool2", 2, 2)
      .conv("3", {.outputs = 512, .kernel = 3, .pad = 1})
      .conv("4", {.outputs = 512, .kernel = 3, .pad = 1})
      .conv("5", {.outputs = 512, .kernel = 3, .pad = 1})
      .max_pool("pool5", 3, 3)
      .net();
}

caffe::NetParameter places_cnds8() {
  Chain chain("places_cnds8_trunk", 227);
  return chain.conv("1", {.outputs = 64, .kernel = 7, .stride = 2, .pad = 1})
      .max_pool("pool1", 3, 2)
      .conv("2", {.outputs = 128, .kernel = 3, .pad = 1})
      .max_pool("pool2", 2, 2)
      .conv("3_1", {.outputs = 256, .kernel = 3, .pad = 1})
      .conv("3_2", {.outputs = 256, .kernel = 3, .pad = 1})
      .max_pool("pool3", 2, 2)
      .conv("4_1", {.outputs = 512, .kernel = 3, .pad = 1})
      .conv("4_2", {.outputs = 512, .kernel = 3, .pad = 1})
      .max_pool("pool4", 2, 2)
      .conv("5_1", {.outputs = 512, .kernel = 3, .pad = 1})
      .conv("5_2", {.outputs = 512, .kernel = 3, .pad = 1})
      .max_pool("pool5", 2, 2)
      .net();
}

/// SqueezeNet's first layers, for range images of 64 beams, extended by an eighth on both sides.
caffe::NetParameter ring64() {
  Chain chain("ring64", {1, 1, 64, 1280});
  return chain.conv("1", {.outputs = 96, .kernel = 7, .stride = 2}).max_pool("pool1", 3, 2).net();
}

caffe::NetParameter ring16() {
  Chain chain("ring16", {1, 1, 16, 1280});
  return chain.conv_and_pool(48, {3, 7}, {2, 8}).net();
}

struct Trunk {
  const char* name;
  caffe::NetParameter (*build)();
};

constexpr Trunk kTrunks[] = {
    {"alexnet", alexnet},           {"caffenet", caffenet}, {"vgg_cnn_s", vgg_cnn_s},
    {"places_cnds8", places_cnds8}, {"ring64", ring64},     {"ring16", ring16},
};

}  // namespace

const std::vector<std::string>& trunk_names() {
  static const std::vector<std::string> names = [] {
    std::vector<std::string> list;
    for (const Trunk& trunk : kTrunks) list.emplace_back(trunk.name);
    return list;
  }();
  return names;
}

caffe::NetParameter trunk(const std::string& name) {
  for (const Trunk& known : kTrunks)
    if (name == known.name) return known.build();
  throw UsageError("unknown network '", name, "'", nearest_name_hint(name, trunk_names()),
                   "; expected one of ", joined(trunk_names(), ", "));
}

}  // namespace revisit::models
