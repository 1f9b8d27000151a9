#include "upgrade.h"

#include <string_view>
#include <unordered_set>

namespace revisit::proto {
namespace {

constexpr int kLegacyAxes = 4;  // num, channels, height, width

void check_one_generation(const caffe::NetParameter& net) {
  if (net.layer_size() == 0 || net.layers_size() == 0) return;
  throw UpgradeError(
      "layers", 0,
      "has both V2 `layer { type: \"Convolution\" ...}` and older `layers { type: CONVOLUTION "
      "...}`; write all of them as `layer`");
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
void upgrade_batch_norm(caffe::NetParameter& net) {
  for (caffe::LayerParameter& layer : *net.mutable_layer()) {
    if (layer.type() != "BatchNorm" || layer.param_size() != 3) continue;
    for (caffe::ParamSpec& param : *layer.mutable_param()) {
      param.set_lr_mult(0);
      param.set_decay_mult(0);
    }
  }
}

/// Converts `hole` of DeepLab's convolutions to dilation. Contradictory values stay.
void upgrade_holes(caffe::NetParameter& net) {
  for (caffe::LayerParameter& layer : *net.mutable_layer()) {
    if (!layer.has_convolution_param()) continue;
    caffe::ConvolutionParameter& param = *layer.mutable_convolution_param();
    const bool hw = param.has_hole_h() && param.has_hole_w();
    const bool one_of_hw = param.has_hole_h() != param.has_hole_w();
    if (one_of_hw || param.has_hole() == hw || param.dilation_size() > 0) continue;
    param.add_dilation(hw ? param.hole_h() : param.hole());
    if (hw) param.add_dilation(param.hole_w());
    param.clear_hole();
    param.clear_hole_h();
    param.clear_hole_w();
  }
}

}  // namespace

void upgrade(caffe::NetParameter& net, ShapelessInputs inputs, const Blame& blame,
             std::vector<std::string>& warnings) {
  check_one_generation(net);
  upgrade_v0(net, blame, warnings);
  upgrade_data_transform(net);
  upgrade_v1(net);
  upgrade_inputs(net, inputs, warnings);
  upgrade_batch_norm(net);
  upgrade_holes(net);
  find_crop_offsets(net, blame, warnings);
}

}  // namespace revisit::proto
