#include "upgrade_v1.h"

#include <vector>

namespace revisit::proto {
namespace {

using V1 = caffe::V1LayerParameter;

const char* type_name(V1::LayerType type) {
  switch (type) {
    case V1::NONE:
      return "";
    case V1::ABSVAL:
      return "AbsVal";
    case V1::ACCURACY:
      return "Accuracy";
    case V1::ARGMAX:
      return "ArgMax";
    case V1::BNLL:
      return "BNLL";
    case V1::CONCAT:
      return "Concat";
    case V1::CONTRASTIVE_LOSS:
      return "ContrastiveLoss";
    case V1::CONVOLUTION:
      return "Convolution";
    case V1::DATA:
      return "Data";
    case V1::DECONVOLUTION:
      return "Deconvolution";
    case V1::DROPOUT:
      return "Dropout";
    case V1::DUMMY_DATA:
      return "DummyData";
    case V1::ELTWISE:
      return "Eltwise";
    case V1::EUCLIDEAN_LOSS:
      return "EuclideanLoss";
    case V1::EXP:
      return "Exp";
    case V1::FLATTEN:
      return "Flatten";
    case V1::HDF5_DATA:
      return "HDF5Data";
    case V1::HDF5_OUTPUT:
      return "HDF5Output";
    case V1::HINGE_LOSS:
      return "HingeLoss";
    case V1::IM2COL:
      return "Im2col";
    case V1::IMAGE_DATA:
      return "ImageData";
    case V1::INFOGAIN_LOSS:
      return "InfogainLoss";
    case V1::INNER_PRODUCT:
      return "InnerProduct";
    case V1::LRN:
      return "LRN";
    case V1::MEMORY_DATA:
      return "MemoryData";
    case V1::MULTINOMIAL_LOGISTIC_LOSS:
      return "MultinomialLogisticLoss";
    case V1::MVN:
      return "MVN";
    case V1::POOLING:
      return "Pooling";
    case V1::POWER:
      return "Power";
    case V1::RELU:
      return "ReLU";
    case V1::SIGMOID:
      return "Sigmoid";
    case V1::SIGMOID_CROSS_ENTROPY_LOSS:
      return "SigmoidCrossEntropyLoss";
    case V1::SILENCE:
      return "Silence";
    case V1::SLICE:
      return "Slice";
    case V1::SOFTMAX:
      return "Softmax";
    case V1::SOFTMAX_LOSS:
      return "SoftmaxWithLoss";
    case V1::SPLIT:
      return "Split";
    case V1::TANH:
      return "TanH";
    case V1::THRESHOLD:
      return "Threshold";
    case V1::WINDOW_DATA:
      return "WindowData";
  }
  return "";
}

template <class DataParameter>
void move_transform(DataParameter& from, V1& layer) {
  if (from.has_scale()) layer.mutable_transform_param()->set_scale(from.scale());
  if (from.has_mean_file()) layer.mutable_transform_param()->set_mean_file(from.mean_file());
  if (from.has_crop_size()) layer.mutable_transform_param()->set_crop_size(from.crop_size());
  if (from.has_mirror()) layer.mutable_transform_param()->set_mirror(from.mirror());
  from.clear_scale();
  from.clear_mean_file();
  from.clear_crop_size();
  from.clear_mirror();
}

/// The i-th ParamSpec, which exists afterwards.
caffe::ParamSpec& param_spec(caffe::LayerParameter& layer, int i) {
  while (layer.param_size() <= i) layer.add_param();
  return *layer.mutable_param(i);
}

/// Sub-messages (include, exclude, blobs, every *_param) are the same in V1 and V2, but for the
/// numbers of their fields.
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
    for (int i = 0; i < from->FieldSize(v1, field); ++i) {
      to->AddMessage(&v2, twin)->CopyFrom(from->GetRepeatedMessage(v1, field, i));
    }
  }
}

void upgrade_layer(const V1& v1, caffe::LayerParameter& v2) {
  if (v1.has_name()) v2.set_name(v1.name());
  if (v1.has_type()) v2.set_type(type_name(v1.type()));
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

void upgrade_data_transform(caffe::NetParameter& net) {
  for (V1& layer : *net.mutable_layers()) {
    if (layer.type() == V1::DATA && layer.has_data_param()) {
      move_transform(*layer.mutable_data_param(), layer);
    } else if (layer.type() == V1::IMAGE_DATA && layer.has_image_data_param()) {
      move_transform(*layer.mutable_image_data_param(), layer);
    } else if (layer.type() == V1::WINDOW_DATA && layer.has_window_data_param()) {
      move_transform(*layer.mutable_window_data_param(), layer);
    }
  }
}

void upgrade_v1(caffe::NetParameter& net) {
  for (const V1& v1 : net.layers()) upgrade_layer(v1, *net.add_layer());
  net.clear_layers();
}

}  // namespace revisit::proto
