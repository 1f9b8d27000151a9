#include "registry.h"

#include <algorithm>

#include "layers/layers.h"

namespace revisit::engine {
namespace {

struct Entry {
  const char* type;
  LayerFactory* make;
};

/// THE table of layer types. ("Input" is not here: it runs nothing, graph.cpp takes it.)
constexpr Entry kTable[] = {
    {"Concat", make_concat},
    {"Convolution", make_convolution},
    {"ConvolutionDepthwise", make_convolution_depthwise},
    {"Deconvolution", make_deconvolution},
    {"DepthwiseConvolution", make_depthwise_convolution},
    {"DetectionOutput", make_detection_output},
    {"Dropout", make_identity},
    {"Filter", make_filter},
    {"Flatten", make_flatten},
    {"Im2col", make_im2col},
    {"InnerProduct", make_inner_product},
    {"Interp", make_interp},
    {"LRN", make_lrn},
    {"LSTM", make_lstm},
    {"Normalize", make_normalize},
    {"Pooling", make_pooling},
    {"PriorBox", make_prior_box},
    {"RNN", make_rnn},
    {"ROIPooling", make_roi_pooling},
    {"ReLU", make_relu},
    {"SPP", make_spp},
    {"Softmax", make_softmax},
    {"Split", make_identity},
    {"Upsample", make_upsample},
};

}  // namespace

std::unique_ptr<Layer> make_layer(const caffe::LayerParameter& param) {
  for (const Entry& entry : kTable)
    if (param.type() == entry.type) return entry.make(param);
  throw UnsupportedError(str("layer type '", param.type(), "' is not supported",
                             did_you_mean(param.type(), layer_types())));
}

std::vector<std::string> layer_types() {
  std::vector<std::string> types{"Input"};
  for (const Entry& entry : kTable) types.emplace_back(entry.type);
  std::sort(types.begin(), types.end());
  return types;
}

void expect_count(size_t found, size_t expected, const char* what) {
  if (found != expected) throw InputError(str("expected ", expected, " ", what, ", found ", found));
}

}  // namespace revisit::engine
