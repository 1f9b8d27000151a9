#include <google/protobuf/text_format.h>

#include <algorithm>
#include <cctype>
#include <sstream>
#include <vector>

#include "net_text.h"
#include "revisit/base/error.h"
#include "upgrade.h"

namespace revisit::proto {
namespace {

using V1 = caffe::V1LayerParameter;

constexpr const char* kV1Types =
    "AbsVal Accuracy ArgMax BNLL Concat ContrastiveLoss Convolution Data Deconvolution Dropout "
    "DummyData Eltwise EuclideanLoss Exp Flatten HDF5Data HDF5Output HingeLoss Im2col ImageData "
    "InfogainLoss InnerProduct LRN MemoryData MultinomialLogisticLoss MVN Pooling Power ReLU "
    "Sigmoid SigmoidCrossEntropyLoss Silence Slice Softmax Split TanH Threshold WindowData "
    // Forks DeepLab, FCN and SegNet, and Caffe shortly before V2.
    "Interp Crop Upsample BN BatchNorm PReLU Reshape ROIPooling";

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

void upgrade_layer(const V1& v1, caffe::LayerParameter& v2) {
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

}  // namespace

std::string type_of_v1(std::string capitals) {
  // V1's names are V2's in capitals with underscores, with one exception.
  if (capitals == "SOFTMAX_LOSS") return "SoftmaxWithLoss";
  std::erase(capitals, '_');
  std::istringstream types(kV1Types);
  for (std::string v2; types >> v2;)
    if (std::ranges::equal(v2, capitals, {}, [](unsigned char c) { return std::toupper(c); }))
      return v2;
  return "";
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

void upgrade_v1(caffe::NetParameter& net) {
  for (const V1& v1 : net.layers()) upgrade_layer(v1, *net.add_layer());
  net.clear_layers();
}

}  // namespace revisit::proto
