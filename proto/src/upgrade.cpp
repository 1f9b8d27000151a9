#include "upgrade.h"

#include <google/protobuf/text_format.h>

#include <algorithm>
#include <cctype>
#include <cmath>
#include <sstream>
#include <string_view>
#include <unordered_set>
#include <vector>

#include "net_text.h"

namespace revisit::proto {
namespace {

constexpr int kLegacyAxes = 4;  // num, channels, height, width

void check_one_generation(const caffe::NetParameter& net) {
  if (net.layer_size() == 0 || net.layers_size() == 0) return;
  throw UpgradeError("layers", 0,
                     "has both V2 `layer { type: \"Convolution\" ...}` and older `layers { type: "
                     "CONVOLUTION ...}`; write all of them as `layer`");
}

std::vector<caffe::BlobShape> input_shapes(const caffe::NetParameter& net) {
  std::vector<caffe::BlobShape> shapes(net.input_shape().begin(), net.input_shape().end());
  if (!shapes.empty()) {
    if (net.input_shape_size() != net.input_size())
      throw UpgradeError("input_shape", 0, "expected one input_shape for each of the ",
                         net.input_size(), " inputs, found ", net.input_shape_size());
    return shapes;
  }
  if (net.input_dim_size() != kLegacyAxes * net.input_size())
    throw UpgradeError("input_dim", 0, "expected ", kLegacyAxes, " input_dim for each of the ",
                       net.input_size(), " inputs, found ", net.input_dim_size());
  for (int i = 0; i < net.input_dim_size(); ++i) {
    if (i % kLegacyAxes == 0) shapes.emplace_back();
    shapes.back().add_dim(net.input_dim(i));
  }
  return shapes;
}

/// In-place layers count as readers only.
std::unordered_set<std::string_view> missed_blobs(const caffe::NetParameter& net) {
  std::unordered_set<std::string_view> missed;
  for (const caffe::LayerParameter& layer : net.layer())
    missed.insert(layer.bottom().begin(), layer.bottom().end());
  for (const caffe::LayerParameter& layer : net.layer()) {
    const std::unordered_set<std::string_view> read(layer.bottom().begin(), layer.bottom().end());
    for (const std::string& blob : layer.top())
      if (!read.contains(blob)) missed.erase(blob);
  }
  return missed;
}

void put_in_front(caffe::LayerParameter& layer, caffe::NetParameter& net) {
  net.add_layer()->Swap(&layer);
  for (int i = net.layer_size() - 1; i > 0; --i) net.mutable_layer()->SwapElements(i, i - 1);
}

void upgrade_inputs(caffe::NetParameter& net, ShapelessInputs inputs,
                    std::vector<std::string>& warnings) {
  caffe::LayerParameter input;
  input.set_name("input");
  input.set_type("Input");
  const bool has_shape = net.input_shape_size() > 0, has_dim = net.input_dim_size() > 0;
  if (net.input_size() == 0) {
    if (has_shape || has_dim)
      warnings.emplace_back("input_shape or input_dim without `input` is ignored");
  } else if (!has_shape && !has_dim) {
    const auto missed = missed_blobs(net);
    for (const std::string& blob : net.input()) {
      if (inputs == ShapelessInputs::kKept && missed.contains(blob)) {
        input.add_top(blob);
      } else {
        warnings.push_back(
            str("`input: \"", blob, "\"` without input_shape or input_dim is ignored"));
      }
    }
    if (input.top_size() > 0) put_in_front(input, net);
  } else {
    if (has_shape && has_dim)
      warnings.emplace_back("input_dim is ignored, because input_shape is given");
    *input.mutable_top() = net.input();
    for (const caffe::BlobShape& shape : input_shapes(net))
      *input.mutable_input_param()->add_shape() = shape;
    put_in_front(input, net);
  }
  net.clear_input();
  net.clear_input_shape();
  net.clear_input_dim();
}

/// Older nets have learning rates for the three statistics blobs of BatchNorm; sets them to 0.
void upgrade_batch_norm(caffe::LayerParameter& layer) {
  if (layer.type() != "BatchNorm" || layer.param_size() != 3) return;
  for (caffe::ParamSpec& param : *layer.mutable_param()) {
    param.set_lr_mult(0);
    param.set_decay_mult(0);
  }
}

/// Converts `hole` of DeepLab's convolutions to dilation. Contradictory values stay.
void upgrade_hole(caffe::LayerParameter& layer) {
  if (!layer.has_convolution_param()) return;
  caffe::ConvolutionParameter& param = *layer.mutable_convolution_param();
  const bool hw = param.has_hole_h() && param.has_hole_w();
  const bool one_of_hw = param.has_hole_h() != param.has_hole_w();
  if (one_of_hw || param.has_hole() == hw || param.dilation_size() > 0) return;
  param.add_dilation(hw ? param.hole_h() : param.hole());
  if (hw) param.add_dilation(param.hole_w());
  param.clear_hole();
  param.clear_hole_h();
  param.clear_hole_w();
}

/// Moves pads of single sides to those of both. The engine rejects contradictory ones, which stay.
template <class Param>
void upgrade_pads(Param& p, bool has_pad) {
  const bool is_upgraded = p.has_pad_h() && !p.has_pad_l() && !p.has_pad_t();
  if (is_upgraded) return;
  const uint32_t left = p.pad_l(), right = p.pad_r(), top = p.pad_t(), bottom = p.pad_b();
  const bool is_padded = left > 0 || right > 0 || top > 0 || bottom > 0;
  if (is_padded && (has_pad || p.has_pad_h() || p.has_pad_w())) return;
  p.clear_pad_l(), p.clear_pad_r();
  p.clear_pad_t(), p.clear_pad_b();
  if (!is_padded) return;
  p.set_pad_h(top), p.set_pad_w(left);
  if (top != bottom || left != right) p.set_pad_b(bottom), p.set_pad_r(right);
}

/// Converts what Synopsys' fork (foss-for-synopsys-dwc-arc-processors/synopsys-caffe) has for
/// TensorFlow's nets.
void upgrade_synopsys(caffe::LayerParameter& layer) {
  if (layer.type() == "ReLU" && layer.relu_param().relu6()) {
    layer.set_type("ReLU6");
    layer.mutable_relu_param()->clear_relu6();
  }
  if (layer.has_convolution_param())
    upgrade_pads(*layer.mutable_convolution_param(), layer.convolution_param().pad_size() > 0);
  if (layer.has_pooling_param())
    upgrade_pads(*layer.mutable_pooling_param(), layer.pooling_param().has_pad());
}

/// DetectionOutput of Synopsys' fork with `no_permute` reads confidences [class][ratio][pixel] and
/// locations [ratio][4][h][w] of each map, and SSD's prior boxes. Returns the layers that order and
/// join them for SSD's DetectionOutput.
std::vector<caffe::LayerParameter> permuting_layers(caffe::LayerParameter& detection) {
  const int n = detection.detection_output_param().nbottom();
  std::vector<caffe::LayerParameter> added;
  const auto add = [&](const char* type, const std::string& bottom, const std::string& top) {
    caffe::LayerParameter& layer = added.emplace_back();
    layer.set_name(top), layer.set_type(type);
    layer.add_bottom(bottom), layer.add_top(top);
    *layer.mutable_include() = detection.include();
    *layer.mutable_exclude() = detection.exclude();
    return &layer;
  };
  caffe::LayerParameter ssd = detection;
  ssd.clear_bottom();
  for (const int first : {n, 0}) {  // locations, then confidences
    ssd.add_bottom(str(detection.name(), first == 0 ? "/confidences" : "/locations"));
    std::vector<std::string> flat;
    for (int i = first; i < first + n; ++i) {
      const std::string name = str(detection.name(), "/", detection.bottom(i));
      auto& order =
          *add("Permute", detection.bottom(i), name + "/ordered")->mutable_permute_param();
      for (const int axis : {0, first == 0 ? 3 : 2, first == 0 ? 2 : 3, 1}) order.add_order(axis);
      flat.push_back(name + "/flat");
      add("Flatten", name + "/ordered", flat.back());
    }
    auto& joined = *add("Concat", flat[0], ssd.bottom().rbegin()[0]);
    for (int i = 1; i < n; ++i) joined.add_bottom(flat[i]);
  }
  ssd.add_bottom(detection.bottom(2 * n));
  ssd.mutable_detection_output_param()->clear_no_permute();
  ssd.mutable_detection_output_param()->clear_nbottom();
  detection.Swap(&ssd);
  return added;
}

/// Converts layers of forks that other layers compute.
void upgrade_twins(caffe::NetParameter& net) {
  caffe::NetParameter result;
  for (caffe::LayerParameter& layer : *net.mutable_layer()) {
    const float low = layer.insanity_param().lb(), high = layer.insanity_param().ub();
    if (layer.type() == "Insanity" && low > 0 && high > low && std::isfinite(high)) {
      layer.mutable_relu_param()->set_negative_slope((std::log(high) - std::log(low)) /
                                                     (high - low));
      layer.clear_insanity_param();
      layer.set_type("ReLU");
    }
    const caffe::UnpoolingParameter& p = layer.unpooling_param();
    if ((layer.type() == "Unpooling" || layer.type() == "UnPooling") && layer.bottom_size() == 2 &&
        p.unpool() == caffe::UnpoolingParameter::MAX &&
        (p.has_unpool_size() || (p.has_unpool_h() && p.has_unpool_w()))) {
      auto& upsample = *layer.mutable_upsample_param();
      upsample.set_upsample_h(p.has_unpool_size() ? p.unpool_size() : p.unpool_h());
      upsample.set_upsample_w(p.has_unpool_size() ? p.unpool_size() : p.unpool_w());
      layer.clear_unpooling_param();
      layer.set_type("Upsample");
    }
    if (layer.type() == "Reshape" && layer.reshape_param().pixelshuffler() != 1) {
      layer.mutable_depth_to_space_param()->set_block_size(layer.reshape_param().pixelshuffler());
      layer.mutable_depth_to_space_param()->set_data_format("CRD");
      layer.clear_reshape_param();
      layer.set_type("DepthToSpace");
    }
    const caffe::ResizeNearestNeighborParameter& resize = layer.resize_nearest_neighbor_param();
    const float factor = resize.scale_height();
    if (layer.type() == "ResizeNearestNeighbor" && resize.data_format() == "NCHW" &&
        !resize.has_output_height() && !resize.has_output_width() && !resize.align_corners() &&
        resize.scale_width() == factor && (factor == 2 || factor == 4 || factor == 8)) {
      layer.mutable_upsample_param()->set_scale(static_cast<uint32_t>(factor));
      layer.clear_resize_nearest_neighbor_param();
      layer.set_type("Upsample");
    }
    if (layer.type() == "BReLU") {
      layer.mutable_clip_param()->set_min(layer.brelu_param().minval());
      layer.mutable_clip_param()->set_max(layer.brelu_param().maxval());
      layer.clear_brelu_param();
      layer.set_type("Clip");
    }
    const caffe::DetectionOutputParameter& detection = layer.detection_output_param();
    if (detection.no_permute() && detection.nbottom() > 0 &&
        layer.bottom_size() == 2 * int64_t{detection.nbottom()} + 1)
      for (caffe::LayerParameter& added : permuting_layers(layer)) *result.add_layer() = added;
    result.add_layer()->Swap(&layer);
  }
  net.mutable_layer()->Swap(result.mutable_layer());
}

template <class Repeated>
void set_axes(Repeated* field, uint32_t depth, uint32_t height_width) {
  field->Clear();
  for (const uint32_t value : {depth, height_width, height_width}) field->Add(value);
}

/// Converts layers of C3D and P3D for volumes [n][c][depth][h][w]. Its padded pooling has other
/// output sizes than Caffe's, and stays.
void upgrade_volume(caffe::LayerParameter& layer) {
  if (layer.type() == "Convolution3D") {
    if (layer.has_convolution3d_param())
      layer.mutable_convolution_param()->Swap(layer.mutable_convolution3d_param());
    caffe::ConvolutionParameter& p = *layer.mutable_convolution_param();
    if (p.kernel_size_size() != 1 || p.pad_size() > 1 || p.stride_size() > 1) return;
    set_axes(p.mutable_kernel_size(), p.kernel_depth(), p.kernel_size(0));
    set_axes(p.mutable_stride(), p.temporal_stride(), p.stride_size() > 0 ? p.stride(0) : 1);
    set_axes(p.mutable_pad(), p.temporal_pad(), p.pad_size() > 0 ? p.pad(0) : 0);
    p.clear_kernel_depth(), p.clear_temporal_stride();
    p.clear_temporal_pad(), p.clear_filter_group();
    layer.clear_convolution3d_param();
    layer.set_type("Convolution");
  } else if (layer.type() == "Pooling3D") {
    if (layer.has_pooling3d_param())
      layer.mutable_pooling_param()->Swap(layer.mutable_pooling3d_param());
    caffe::PoolingParameter& p = *layer.mutable_pooling_param();
    layer.clear_pooling3d_param();
    if (p.pad() > 0 || p.pad_l() > 0) return;
    set_axes(p.mutable_kernel_size_nd(), p.has_kernel_l() ? p.kernel_l() : p.kernel_depth(),
             p.kernel_size());
    set_axes(p.mutable_stride_nd(), p.has_stride_l() ? p.stride_l() : p.temporal_stride(),
             p.stride());
    p.clear_kernel_depth(), p.clear_temporal_stride();
    p.clear_kernel_l(), p.clear_stride_l(), p.clear_pad_l();
    layer.set_type("Pooling");
  } else if (layer.type() == "PoolingND" && !layer.has_pooling_param()) {  // 3D-Caffe
    caffe::PoolingParameter& p = *layer.mutable_pooling_nd_param();
    const bool is_padded = std::ranges::any_of(p.pad_nd(), [](uint32_t pad) { return pad > 0; });
    if (p.pad() > 0 || is_padded || p.global_pooling()) return;
    layer.mutable_pooling_param()->Swap(&p);
    layer.clear_pooling_nd_param();
    layer.set_type("Pooling");
  }
}

using V1 = caffe::V1LayerParameter;

constexpr const char* kV1Types =
    "AbsVal Accuracy ArgMax BNLL Concat ContrastiveLoss Convolution Data Deconvolution Dropout "
    "DummyData Eltwise EuclideanLoss Exp Flatten HDF5Data HDF5Output HingeLoss Im2col ImageData "
    "InfogainLoss InnerProduct LRN MemoryData MultinomialLogisticLoss MVN Pooling Power ReLU "
    "Sigmoid SigmoidCrossEntropyLoss Silence Slice Softmax Split TanH Threshold WindowData "
    // Forks DeepLab, FCN and SegNet, and Caffe shortly before V2.
    "Interp Crop Upsample BN BatchNorm PReLU Reshape ROIPooling "
    // C3D, DeconvNet.
    "Convolution3D Pooling3D Unpooling";

void move_transform(google::protobuf::Message& from, V1& layer) {
  for (const char* name : {"scale", "mean_file", "crop_size", "mirror"}) {
    const auto* field = from.GetDescriptor()->FindFieldByName(name);
    if (!from.GetReflection()->HasField(from, field)) continue;
    merge_field(from, *field, "transform_param", name, layer);
    from.GetReflection()->ClearField(&from, field);
  }
}

caffe::ParamSpec& param_spec(caffe::LayerParameter& layer, int i) {
  while (layer.param_size() <= i) layer.add_param();
  return *layer.mutable_param(i);
}

/// Sub-messages (include, blobs, *_param) of V1 and V2 differ only in their field numbers.
void copy_messages(const V1& v1, caffe::LayerParameter& v2) {
  const auto* from = V1::GetReflection();
  const auto* to = caffe::LayerParameter::GetReflection();
  std::vector<const google::protobuf::FieldDescriptor*> fields;
  from->ListFields(v1, &fields);
  for (const auto* field : fields) {
    const auto* twin = caffe::LayerParameter::descriptor()->FindFieldByName(field->name());
    if (!twin || !field->message_type() || twin->message_type() != field->message_type()) continue;
    if (!field->is_repeated()) {
      to->MutableMessage(&v2, twin)->CopyFrom(from->GetMessage(v1, field));
      continue;
    }
    for (int i = 0; i < from->FieldSize(v1, field); ++i)
      to->AddMessage(&v2, twin)->CopyFrom(from->GetRepeatedMessage(v1, field, i));
  }
}

void upgrade_v1_layer(const V1& v1, caffe::LayerParameter& v2) {
  if (v1.has_name()) v2.set_name(v1.name());
  const std::string marked = marked_type(v1);
  const std::string type = v1.has_type() ? V1::LayerType_Name(v1.type()) : marked;
  const std::string known = type_of_v1(type);
  if (!type.empty()) v2.set_type(known.empty() ? marked : known);
  if (known == "Crop" && !v1.has_crop_param()) v2.set_type(kAligningCrop);
  copy_marks(v1, v2);
  *v2.mutable_bottom() = v1.bottom();
  *v2.mutable_top() = v1.top();
  *v2.mutable_loss_weight() = v1.loss_weight();
  for (int i = 0; i < v1.param_size(); ++i) param_spec(v2, i).set_name(v1.param(i));
  for (int i = 0; i < v1.blob_share_mode_size(); ++i) {
    const bool strict = v1.blob_share_mode(i) == V1::STRICT;
    param_spec(v2, i).set_share_mode(strict ? caffe::ParamSpec::STRICT
                                            : caffe::ParamSpec::PERMISSIVE);
  }
  for (int i = 0; i < v1.blobs_lr_size(); ++i) param_spec(v2, i).set_lr_mult(v1.blobs_lr(i));
  for (int i = 0; i < v1.weight_decay_size(); ++i)
    param_spec(v2, i).set_decay_mult(v1.weight_decay(i));
  copy_messages(v1, v2);
}

/// Moves scale, mean_file, crop_size and mirror of V1 data layers into `transform_param`.
void upgrade_data_transform(caffe::NetParameter& net) {
  for (V1& layer : *net.mutable_layers()) {
    if (layer.type() == V1::DATA && layer.has_data_param())
      move_transform(*layer.mutable_data_param(), layer);
    if (layer.type() == V1::IMAGE_DATA && layer.has_image_data_param())
      move_transform(*layer.mutable_image_data_param(), layer);
    if (layer.type() == V1::WINDOW_DATA && layer.has_window_data_param())
      move_transform(*layer.mutable_window_data_param(), layer);
  }
}

/// Requires a net without V2 layers.
void upgrade_v1(caffe::NetParameter& net) {
  for (const V1& v1 : net.layers()) upgrade_v1_layer(v1, *net.add_layer());
  net.clear_layers();
}

}  // namespace

std::string type_of_v1(std::string capitals) {
  // V1's names are V2's in capitals with underscores, with one exception.
  std::string words;  // "ImageSegData" of IMAGE_SEG_DATA, a data layer of a fork
  for (size_t i = 0; i < capitals.size(); ++i)
    if (capitals[i] != '_')
      words += static_cast<char>(i > 0 && capitals[i - 1] != '_'
                                     ? std::tolower(static_cast<unsigned char>(capitals[i]))
                                     : capitals[i]);
  if (capitals == "SOFTMAX_LOSS") return "SoftmaxWithLoss";
  std::erase(capitals, '_');
  std::istringstream types(kV1Types);
  for (std::string v2; types >> v2;)
    if (std::ranges::equal(v2, capitals, {}, [](unsigned char c) { return std::toupper(c); }))
      return v2;
  return words.ends_with("Data") ? words : "";
}

bool merge_field(const google::protobuf::Message& from,
                 const google::protobuf::FieldDescriptor& field, const std::string& message,
                 const std::string& name, google::protobuf::Message& to) {
  using google::protobuf::TextFormat;
  std::string value;
  TextFormat::PrintFieldValueToString(from, &field, -1, &value);
  const bool is_message = field.message_type() != nullptr;
  TextFormat::Parser parser;
  Silence silence;
  parser.RecordErrorsTo(&silence);
  return parser.MergeFromString(
      str(message, " { ", name, is_message ? " { " : ": ", value, is_message ? " } }" : " }"), &to);
}

void upgrade(caffe::NetParameter& net, ShapelessInputs inputs, AmbiguousCrops crops,
             const Blame& blame, std::vector<std::string>& warnings) {
  check_one_generation(net);
  upgrade_v0(net, blame, warnings);
  upgrade_data_transform(net);
  upgrade_v1(net);
  upgrade_inputs(net, inputs, warnings);
  for (caffe::LayerParameter& layer : *net.mutable_layer())
    for (const auto step : {upgrade_batch_norm, upgrade_hole, upgrade_volume, upgrade_synopsys})
      step(layer);
  upgrade_twins(net);
  find_crop_offsets(net, crops, blame, warnings);
}

}  // namespace revisit::proto
