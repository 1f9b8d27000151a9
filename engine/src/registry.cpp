#include <strings.h>

#include <algorithm>

#include "layers/layers.h"
#include "revisit/proto/net_file.h"

namespace revisit::engine {
namespace {

struct Entry {
  const char* type;
  LayerFactory* make;
  const char* origin;
  const char* does;
  bool has_weights = false;
  const char* other_forks = nullptr;  // set if the file cannot show which fork's layer it means
};

constexpr bool kTrained = true;

constexpr Entry kTable[] = {
    {"AbsVal", make_abs_val, "Caffe", "absolute value"},
    {"Accuracy", make_accuracy, "Caffe", "fraction of labels among the k best scores"},
    {"ArgMax", make_argmax, "Caffe", "index and value of the largest entries"},
    {"Axpy", make_axpy, "SENet", "a x + y, a per channel"},
    {"BatchNorm", make_batch_norm, "Caffe", "(x - mean) / deviation per channel", kTrained},
    {"BatchReindex", make_batch_reindex, "Caffe", "selects and repeats batch items"},
    {"Bias", make_bias, "Caffe", "adds a trained or given blob", kTrained},
    {"BN", make_bn, "PSPNet, SegNet", "batch normalization with trained scale and shift", kTrained},
    {"BNLL", make_bnll, "Caffe", "log(1 + exp x)"},
    {"BoxGroupOutput", make_box_group_output, "Cascade R-CNN",
     "boxes of several anchors per map after suppression"},
    {"BoxOutput", make_box_output, "MS-CNN", "boxes of one anchor per map after suppression"},
    {"Clip", make_clip, "Caffe", "limits to [min, max]"},
    {"Concat", make_concat, "Caffe", "joins along an axis"},
    {"Convolution", make_convolution, "Caffe",
     "1-D, 2-D, 3-D and more; group, stride, pad, dilation", kTrained},
    {"ConvolutionDepthwise", make_convolution_depthwise, "forks",
     "convolution, one group per channel", kTrained},
    {"Crop", make_crop, "Caffe", "crops to the size of another blob"},
    {"CropCenter", make_crop_center, "waifu2x-caffe", "crops both ends of axes"},
    {"DecodeBBox", make_decode_bbox, "Cascade R-CNN", "regions moved by offsets"},
    {"Deconvolution", make_deconvolution, "Caffe", "transposed convolution", kTrained},
    {"DepthwiseConvolution", make_depthwise_convolution, "forks",
     "convolution, one group per channel", kTrained},
    {"DetectionOutput", make_detection_output, "SSD", "boxes after decoding and suppression"},
    {"Dropout", make_dropout, "Caffe",
     "identity at inference; with options of forks, scales or drops"},
    {"DummyData", make_dummy_data, "Caffe", "constants"},
    {"Eltwise", make_eltwise, "Caffe", "product, weighted sum, maximum"},
    {"ELU", make_elu, "Caffe", "exponential linear unit"},
    {"Embed", make_embed, "Caffe", "rows of a table by index", kTrained},
    {"EuclideanLoss", make_euclidean_loss, "Caffe", "half the squared distance, mean over images"},
    {"Exp", make_exp, "Caffe", "base ^ (shift + scale x)"},
    {"Filter", make_filter, "Caffe", "batch items selected by another blob"},
    {"Flatten", make_flatten, "Caffe", "merges axes"},
    {"Flip", make_flip, "caffe-windows", "mirrors images"},
    {"Im2col", make_im2col, "Caffe", "windows as columns"},
    {"InnerProduct", make_inner_product, "Caffe", "fully connected", kTrained},
    {"Interp", make_interp, "DeepLab, PSPNet", "bilinear resampling"},
    {"Log", make_log, "Caffe", "log_base(shift + scale x)"},
    {"LRN", make_lrn, "Caffe", "local response normalization, across or within channels"},
    {"LSTM", make_lstm, "Caffe", "long short-term memory", kTrained},
    {"Lstm", make_rows_lstm, "CTPN, caffe-lstm",
     "long short-term memory, weights in different order", kTrained},
    {"Mish", make_mish, "YOLOv4", "x tanh(ln(1 + exp x))"},
    {"MVN", make_mvn, "Caffe", "mean and variance normalization"},
    {"Normalize", make_normalize, "SSD", "L2 normalization with a trained scale", kTrained},
    {"Parameter", make_parameter, "Caffe", "a trained blob", kTrained},
    {"Permute", make_permute, "SSD", "reorders axes"},
    {"Pooling", make_pooling, "Caffe", "maximum (with mask), average, global"},
    {"Power", make_power, "Caffe", "(shift + scale x) ^ power"},
    {"PReLU", make_prelu, "Caffe", "leaky ReLU with trained slopes", kTrained},
    {"PriorBox", make_prior_box, "SSD", "default boxes"},
    {"PriorBoxClustered", make_prior_box_clustered, "OpenVINO", "default boxes of given sizes"},
    {"Proposal", make_proposal, "Faster R-CNN", "regions from scores and offsets of anchors"},
    {"PSROIPooling", make_psroi_pooling, "R-FCN",
     "position-sensitive average of each bin of regions"},
    {"Reduction", make_reduction, "Caffe", "sum, absolute sum, sum of squares, mean"},
    {"ReLU", make_relu, "Caffe", "max(x, 0), or leaky"},
    {"ReLU6", make_relu6, "forks", "min(max(x, 0), 6)"},
    {"Reorg", make_reorg, "YOLOv2", "moves pixels of blocks to channels, or back", !kTrained,
     "as in Darknet and MobileNet-YOLO; the Reorg of Synopsys' fork swaps rows and columns"},
    {"Reshape", make_reshape, "Caffe", "changes the shape"},
    {"Reverse", make_reverse, "CTPN, Caffe OCR", "reverses the order along axes"},
    {"RNN", make_rnn, "Caffe", "simple recurrent network", kTrained},
    {"ROIAlign", make_roi_align, "Cascade R-CNN", "bilinear values at corners of bins of regions",
     !kTrained,
     "as in MS-CNN and Cascade R-CNN; the ROIAlign of makefile/frcnn has the same fields, "
     "but computes differently"},
    {"ROIPooling", make_roi_pooling, "Fast R-CNN", "maximum over regions of interest"},
    {"Scale", make_scale, "Caffe", "multiplies by a trained or given blob", kTrained},
    {"ShuffleChannel", make_shuffle_channel, "ShuffleNet", "interleaves groups of channels"},
    {"Sigmoid", make_sigmoid, "Caffe", "1 / (1 + exp(-x))"},
    {"Silence", make_silence, "Caffe", "discards its inputs"},
    {"Slice", make_slice, "Caffe", "cuts along an axis"},
    {"Softmax", make_softmax, "Caffe", "softmax along an axis"},
    {"SoftmaxWithLoss", make_softmax_with_loss, "Caffe", "mean of -log softmax of the labels"},
    {"Split", make_identity, "Caffe", "copies of the input"},
    {"SPP", make_spp, "Caffe", "spatial pyramid pooling"},
    {"Swish", make_swish, "Caffe", "x sigmoid(beta x)"},
    {"TanH", make_tanh, "Caffe", "hyperbolic tangent"},
    {"Threshold", make_threshold, "Caffe", "1 above a threshold, else 0"},
    {"Tile", make_tile, "Caffe", "repeats along an axis"},
    {"Transpose", make_transpose, "CTPN, Caffe OCR", "reorders axes"},
    {"Upsample", make_upsample, "SegNet and others", "unpooling by mask, or nearest neighbor"},
    {"YoloDetectionOutput", make_yolo_detection_output, "MobileNet-YOLO",
     "boxes of YOLO v2 after suppression"},
    {"Yolov3DetectionOutput", make_yolov3_detection_output, "MobileNet-YOLO",
     "boxes of YOLO v3 after suppression"},
};

const Entry* entry_of(const std::string& type) {
  const auto* const entry =
      std::ranges::find_if(kTable, [&](const Entry& e) { return type == e.type; });
  return entry == std::end(kTable) ? nullptr : entry;
}

}  // namespace

bool is_supported(const std::string& type) {
  return type == kInputType || entry_of(type);
}

void check_type(const caffe::LayerParameter& param) {
  if (is_supported(param.type())) return;
  if (param.type().empty()) throw InputError("has no type; give it one, e.g. type: \"ReLU\"");
  std::vector<std::string> known;
  for (const LayerType& type : layer_types()) known.push_back(type.type);
  const std::string fork = proto::fork_of(param.type());
  const std::string hint =
      fork.empty() ? misspelling_hint(param.type(), known) : str("; it is of ", fork);
  if (param.type() == "Python")
    throw UnsupportedError("layers of type 'Python' run in revisit.caffe only");
  if (param.bottom_size() == 0 && param.top_size() > 0)
    throw UnsupportedError("layer type '", param.type(), "' is not supported", hint,
                           "; it reads no blob: if it reads data, write an Input layer instead");
  throw UnsupportedError(
      "layer type '", param.type(), "' is not supported", hint,
      "; end the net before it, or write it as a Python layer for revisit.caffe");
}

std::unique_ptr<Layer> make_layer(const caffe::LayerParameter& param) {
  check_type(param);
  return param.type() == kInputType ? nullptr : entry_of(param.type())->make(param);
}

std::string ambiguity_of(const caffe::LayerParameter& param) {
  if (param.type() == "Reverse" && param.reverse_param().axis().empty())
    return "along axis 0, as in CTPN; the Reverse of Synopsys' fork is the identity without an "
           "axis";
  const Entry* const entry = entry_of(param.type());
  return entry && entry->other_forks ? entry->other_forks : "";
}

std::vector<LayerType> layer_types() {
  std::vector<LayerType> types{{kInputType, "Caffe", "an input of the net"}};
  for (const Entry& entry : kTable) types.push_back({entry.type, entry.origin, entry.does});
  std::stable_sort(types.begin(), types.end(), [](const LayerType& a, const LayerType& b) {
    return strcasecmp(a.type.c_str(), b.type.c_str()) < 0;
  });
  return types;
}

std::set<std::string> types_with_weights() {
  std::set<std::string> types;
  for (const Entry& entry : kTable)
    if (entry.has_weights) types.insert(entry.type);
  return types;
}

}  // namespace revisit::engine
