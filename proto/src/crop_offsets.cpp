#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <optional>
#include <set>
#include <string_view>

#include "revisit/base/error.h"
#include "upgrade.h"

namespace revisit::proto {
namespace {

using Layer = caffe::LayerParameter;

const std::set<std::string_view> kPixelByPixel = {
    "AbsVal", "BatchNorm", "Bias",    "BNLL", "Dropout",  "Eltwise", "ELU",
    "Log",    "LRN",       "Exp",     "MVN",  "Power",    "ReLU",    "PReLU",
    "Scale",  "Split",     "Sigmoid", "TanH", "Threshold"};

/// Mapping along one axis: pixel i of one array is at i * scale + shift of another.
struct Place {
  double scale = 1, shift = 0;
};
using PlaceHw = std::array<Place, 2>;

PlaceHw composed(const PlaceHw& base, const PlaceHw& layer) {
  PlaceHw place;
  for (size_t i = 0; i < place.size(); ++i)
    place[i] = {base[i].scale * layer[i].scale, base[i].scale * layer[i].shift + base[i].shift};
  return place;
}

template <class Repeated>
double of_axis(const Repeated& field, int axis, double absent) {
  return field.empty() ? absent : static_cast<double>(field.Get(std::min(axis, field.size() - 1)));
}

Place window_place(double kernel, double stride, double pad) {
  return {1 / stride, (pad - (kernel - 1) / 2) / stride};
}

PlaceHw convolution_place(const caffe::ConvolutionParameter& p) {
  PlaceHw place;
  for (int i = 0; i < 2; ++i) {
    const double kernel =
        p.has_kernel_h() ? (i == 0 ? p.kernel_h() : p.kernel_w()) : of_axis(p.kernel_size(), i, 1);
    const double stride =
        p.has_stride_h() ? (i == 0 ? p.stride_h() : p.stride_w()) : of_axis(p.stride(), i, 1);
    const double pad = p.has_pad_h() ? (i == 0 ? p.pad_h() : p.pad_w()) : of_axis(p.pad(), i, 0);
    place[i] = window_place((kernel - 1) * of_axis(p.dilation(), i, 1) + 1, stride, pad);
  }
  return place;
}

PlaceHw pooling_place(const caffe::PoolingParameter& p) {
  const auto of = [](bool has_hw, uint32_t of_axis, uint32_t both) {
    return has_hw ? of_axis : both;
  };
  return {window_place(of(p.has_kernel_h(), p.kernel_h(), p.kernel_size()),
                       of(p.has_stride_h(), p.stride_h(), p.stride()),
                       of(p.has_pad_h(), p.pad_h(), p.pad())),
          window_place(of(p.has_kernel_w(), p.kernel_w(), p.kernel_size()),
                       of(p.has_stride_w(), p.stride_w(), p.stride()),
                       of(p.has_pad_w(), p.pad_w(), p.pad()))};
}

/// Maps pixels of the input of a layer to its output; nullopt if there is no such mapping.
std::optional<PlaceHw> place_in_output(const Layer& layer) {
  if (kPixelByPixel.contains(layer.type())) return PlaceHw{};
  if (layer.type() == "Convolution") return convolution_place(layer.convolution_param());
  if (layer.type() == "Pooling" && !layer.pooling_param().global_pooling())
    return pooling_place(layer.pooling_param());
  if (layer.type() == "Deconvolution") {
    PlaceHw place = convolution_place(layer.convolution_param());
    for (Place& axis : place) axis = {1 / axis.scale, -axis.shift / axis.scale};
    return place;
  }
  if (layer.type() == "Crop" && layer.crop_param().axis() == 2) {
    PlaceHw place;
    for (int i = 0; i < 2; ++i) place[i].shift = -of_axis(layer.crop_param().offset(), i, 0);
    return place;
  }
  return std::nullopt;
}

class Offsets {
 public:
  explicit Offsets(caffe::NetParameter& net) : net_(net) {
    std::map<std::string_view, int> current;
    for (int i = 0; i < net.layer_size(); ++i) {
      std::vector<int>& inputs = inputs_.emplace_back();
      for (const std::string& bottom : net.layer(i).bottom()) {
        const auto found = current.find(bottom);
        inputs.push_back(found == current.end() ? -1 : found->second);
      }
      for (const std::string& top : net.layer(i).top()) current[top] = i;
    }
  }

  /// Rows and columns to crop so that the two inputs align.
  std::optional<std::array<uint32_t, 2>> of(int crop) const {
    if (inputs_[crop].size() != 2) return std::nullopt;
    const Places from = places_in(inputs_[crop][0]), to = places_in(inputs_[crop][1]);
    for (size_t common = from.size(); common-- > 0;) {
      if (!from[common] || common >= to.size() || !to[common]) continue;
      std::array<uint32_t, 2> offsets{};
      for (size_t i = 0; i < offsets.size(); ++i) {
        const Place a = (*from[common])[i], b = (*to[common])[i];
        const double offset = a.shift - b.shift;
        if (a.scale != b.scale || offset < 0 || offset != std::round(offset) || offset > INT32_MAX)
          return std::nullopt;
        offsets[i] = static_cast<uint32_t>(offset);
      }
      return offsets;
    }
    return std::nullopt;
  }

 private:
  /// Maps pixels of each layer's output to the output of one later layer.
  using Places = std::vector<std::optional<PlaceHw>>;

  Places places_in(int last) const {
    Places places(last + 1);
    if (last >= 0) places[last] = PlaceHw{};
    for (int i = last; i >= 0; --i) {
      if (!places[i]) continue;
      const std::optional<PlaceHw> step = place_in_output(net_.layer(i));
      if (!step) continue;
      const size_t n_inputs = net_.layer(i).type() == "Crop" ? 1 : inputs_[i].size();
      for (size_t j = 0; j < n_inputs; ++j)
        if (const int input = inputs_[i][j]; input >= 0 && !places[input])
          places[input] = composed(*places[i], *step);
    }
    return places;
  }

  const caffe::NetParameter& net_;
  std::vector<std::vector<int>> inputs_;  // [layer][bottom]: layer that wrote it, or -1
};

}  // namespace

void find_crop_offsets(caffe::NetParameter& net, AmbiguousCrops crops, const Blame& blame,
                       std::vector<std::string>& warnings) {
  constexpr int kMaxCrops = 100;  // bounds the cost: each crop traverses the net
  const auto n_crops = std::ranges::count_if(net.layer(), [](const Layer& layer) {
    return layer.type() == kAligningCrop || layer.type() == "Crop";
  });
  if (n_crops == 0) return;
  if (n_crops > kMaxCrops) {
    for (Layer& layer : *net.mutable_layer()) {
      if (layer.type() != kAligningCrop) continue;
      layer.set_type("Crop");
      blame(layer,
            str("its offset is not computed, because the net has ", n_crops, " crops (limit ",
                kMaxCrops, "); give crop_param { axis: 2 offset: ... }"),
            -1);
    }
    return;
  }
  const Offsets offsets(net);
  for (int i = 0; i < net.layer_size(); ++i) {
    Layer& layer = *net.mutable_layer(i);
    const bool aligns = layer.type() == kAligningCrop;
    if (!aligns && (layer.type() != "Crop" || layer.has_crop_param())) continue;
    const auto found = offsets.of(i);
    if (!found) continue;
    const auto [h, w] = *found;
    if (aligns) {
      layer.set_type("Crop");
      layer.mutable_crop_param()->add_offset(h);
      layer.mutable_crop_param()->add_offset(w);
    } else if (h + w > 0) {
      const std::string offset = str("crop_param { axis: 2 offset: ", h, " offset: ", w, " }");
      if (crops == AmbiguousCrops::kStartAtZero)
        warnings.push_back(
            str("layer '", layer.name(), "' (Crop): has no crop_param and starts at ",
                "the first pixel, as in Caffe; forks of FCN and HED compute ", offset));
      else
        blame(layer,
              str("has no crop_param: forks of FCN and HED compute the offset, Caffe starts at 0; ",
                  "add ", offset, " for theirs, or crop_param { axis: 2 offset: 0 } for Caffe's"),
              -1);
    }
  }
}

}  // namespace revisit::proto
