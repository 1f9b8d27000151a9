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
    {"AbsVal", make_abs_val},
    {"ArgMax", make_argmax},
    {"Axpy", make_axpy},
    {"BatchNorm", make_batch_norm},
    {"BatchReindex", make_batch_reindex},
    {"Bias", make_bias},
    {"BNLL", make_bnll},
    {"Clip", make_clip},
    {"Concat", make_concat},
    {"Convolution", make_convolution},
    {"ConvolutionDepthwise", make_convolution_depthwise},
    {"Crop", make_crop},
    {"Deconvolution", make_deconvolution},
    {"DepthwiseConvolution", make_depthwise_convolution},
    {"DetectionOutput", make_detection_output},
    {"Dropout", make_identity},
    {"DummyData", make_dummy_data},
    {"Eltwise", make_eltwise},
    {"ELU", make_elu},
    {"Embed", make_embed},
    {"Exp", make_exp},
    {"Filter", make_filter},
    {"Flatten", make_flatten},
    {"Im2col", make_im2col},
    {"InnerProduct", make_inner_product},
    {"Interp", make_interp},
    {"Log", make_log},
    {"LRN", make_lrn},
    {"LSTM", make_lstm},
    {"MVN", make_mvn},
    {"Normalize", make_normalize},
    {"Parameter", make_parameter},
    {"Permute", make_permute},
    {"Pooling", make_pooling},
    {"Power", make_power},
    {"PReLU", make_prelu},
    {"PriorBox", make_prior_box},
    {"Reduction", make_reduction},
    {"ReLU", make_relu},
    {"ReLU6", make_relu6},
    {"Reshape", make_reshape},
    {"RNN", make_rnn},
    {"ROIPooling", make_roi_pooling},
    {"Scale", make_scale},
    {"ShuffleChannel", make_shuffle_channel},
    {"Sigmoid", make_sigmoid},
    {"Silence", make_silence},
    {"Slice", make_slice},
    {"Softmax", make_softmax},
    {"Split", make_identity},
    {"SPP", make_spp},
    {"Swish", make_swish},
    {"TanH", make_tanh},
    {"Threshold", make_threshold},
    {"Tile", make_tile},
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
