#include <algorithm>
#include <charconv>
#include <cmath>
#include <map>
#include <optional>
#include <regex>

#include "revisit/base/error.h"
#include "revisit/base/text.h"
#include "upgrade.h"

namespace revisit::proto {
namespace {

using Numbers = std::vector<float>;
using Parameters = std::map<std::string, Numbers>;

constexpr size_t kLongest = 1000;  // std::regex takes stack for each character of a text

std::optional<float> number_of(const std::string& text) {
  float number = 0;
  const char* const end = text.data() + text.size();
  const auto [stop, error] = std::from_chars(text.data(), end, number);
  return error == std::errc() && stop == end ? std::optional(number) : std::nullopt;
}

/// Reads the subset of YAML in such layers: quoted keys with numbers or lists of numbers, in braces
/// or one per line. Returns nullopt for any other text.
std::optional<Parameters> parameters_of(std::string text) {
  static const std::regex kNumber(R"([-+.\w]+)"),
      kEntry(R"re( *(?:'([^']+)'|"([^"]+)") *: *(?:!!python/tuple)? *)re"
             R"((\[ *[-+.\w]+ *(?:, *[-+.\w]+ *)*(?:, *)?\]|[-+.\w]+) *)");
  text.erase(text.find_last_not_of(" \n") + 1);
  text.erase(0, text.find_first_not_of(' '));
  const bool braces = text.starts_with('{');
  if (text.size() > kLongest || text.ends_with('}') != braces) return std::nullopt;
  Parameters all;
  std::smatch entry;
  for (auto at = text.cbegin() + braces;; ++at) {
    const auto end = text.cend() - braces;
    if (!std::regex_search(at, end, entry, kEntry, std::regex_constants::match_continuous))
      return std::nullopt;
    Numbers& numbers = all[entry[1].str() + entry[2].str()];
    if (!numbers.empty()) return std::nullopt;  // the key is there twice
    for (std::sregex_iterator found(entry[3].first, entry[3].second, kNumber), none; found != none;
         ++found) {
      const auto number = number_of(found->str());
      if (!number) return std::nullopt;
      numbers.push_back(*number);
    }
    at = entry[0].second;
    if (at == end) return all;
    if (*at != (braces ? ',' : '\n')) return std::nullopt;
  }
}

/// Parameters of a ProposalLayer with `scales`, or of sanghoon/pva-faster-rcnn's with `ratios`,
/// too, or of makefile/frcnn's FrcnnProposal, whose settings are in no prototxt; nullopt for any
/// other layer.
std::optional<caffe::ProposalParameter> proposal_of(const caffe::LayerParameter& layer) {
  const caffe::PythonParameter& python = layer.python_param();
  const bool is_bare = layer.type() == "FrcnnProposal" && !layer.has_proposal_param();
  const bool is_python = layer.type() == "Python" && python.module() == "rpn.proposal_layer" &&
                         python.layer() == "ProposalLayer" &&
                         (!layer.has_phase() || layer.phase() != caffe::TRAIN);
  if (!(is_bare || is_python) || layer.bottom_size() != 3 || layer.top_size() < 1 ||
      layer.top_size() > 2)
    return std::nullopt;
  auto given = is_bare ? Parameters{{"feat_stride", {16}}} : parameters_of(python.param_str());
  if (!given) return std::nullopt;
  const auto take = [&](const char* key, const Numbers& absent) {
    const auto found = given->extract(key);
    return found ? found.mapped() : absent;
  };
  const Numbers stride = take("feat_stride", {}), ratios = take("ratios", {0.5F, 1, 2}),
                scales = take("scales", {8, 16, 32});
  if (!given->empty() || stride.size() != 1 || !(stride[0] >= 1 && stride[0] <= 1e6F) ||
      stride[0] != std::floor(stride[0]))
    return std::nullopt;
  caffe::ProposalParameter param;
  param.set_feat_stride(static_cast<uint32_t>(stride[0]));
  param.set_base_size(16);
  param.set_min_size(16);
  param.mutable_ratio()->Add(ratios.begin(), ratios.end());
  param.mutable_scale()->Add(scales.begin(), scales.end());
  param.set_pre_nms_topn(6000);
  param.set_post_nms_topn(300);
  param.set_nms_thresh(0.7F);
  return param;
}

/// Crops the first input of PythonConcatLayer (demonzyj56/py-faster-rcnn) to the second.
caffe::LayerParameter crop_before(caffe::LayerParameter& concat) {
  caffe::LayerParameter crop;
  crop.set_name(concat.name() + "/cropped"), crop.set_type("Crop");
  *crop.mutable_bottom() = concat.bottom();
  crop.add_top(crop.name());
  crop.mutable_crop_param()->add_offset(0);
  concat.set_bottom(0, crop.name());
  return crop;
}

/// Number of `key` in the text of a Python dictionary, also if it is quoted; 0 if there is none.
float number_in(const std::string& text, const std::string& key) {
  std::smatch found;
  const std::regex value("['\"]" + key + R"(['"]\s*:[ '"]*([-+.\w]+)['"]?\s*(?:[,}\n]|$))");
  if (text.size() > kLongest || !std::regex_search(text, found, value)) return 0;
  return number_of(found[1]).value_or(0);
}

/// Gives a Python layer of a public fork a type that computes the same; false for any other.
bool give_type(caffe::LayerParameter& layer) {
  const std::string &name = layer.python_param().layer(), &text = layer.python_param().param_str();
  const std::string from = str(layer.python_param().module(), ".", name);
  if (from == "yolov2.darknet_reorg") {  // Synopsys' fork
    layer.mutable_reorg_param()->set_stride(2);
    layer.set_type("Reorg");
  } else if (from == "interp.UpsamplingBilinear2d") {  // jasonlovescoding/YOLOv3-caffe: nearest
    const float zoom = number_in(text, "zoom_factor");
    if (!(zoom >= 1 && zoom <= 1e6F) || zoom != std::floor(zoom)) return false;
    layer.mutable_upsample_param()->set_scale(static_cast<uint32_t>(zoom));
    layer.set_type("Upsample");
  } else if (from == "spatial_dropout.SpatialDropoutLayer") {  // ENet: scales in all phases
    const float p = number_in(text, "p");
    if (!(p > 0 && p < 1) || text.find("'TRAIN'") != std::string::npos) return false;
    layer.mutable_power_param()->set_scale(1 / (1 - p));
    layer.set_type("Power");
  } else if (from == "triplet.l2norm_layer.L2NormLayer") {  // hizhangp/triplet: zeros stay
    layer.mutable_normalize_param()->set_normalize_type("L2");
    layer.mutable_norm_param()->set_eps(1e-36F);
    layer.set_type("Normalize");
  } else if (from == "concat_layer.layer.PythonConcatLayer" && layer.bottom_size() == 2) {
    layer.set_type("Concat");
  } else {
    return false;
  }
  layer.clear_python_param();
  return true;
}

}  // namespace

void replace_python_layers(caffe::NetParameter& net, bool keep_python,
                           std::vector<std::string>& warnings) {
  caffe::NetParameter result;
  for (caffe::LayerParameter& layer : *net.mutable_layer()) {
    const bool is_python = layer.type() == "Python";
    const std::string start = str("layer '", layer.name(), "' (", is_python ? "Python: " : "",
                                  is_python ? layer.python_param().layer() : layer.type(), ") ");
    if (is_python && !keep_python && give_type(layer)) {
      if (layer.type() == "Concat") *result.add_layer() = crop_before(layer);
      warnings.push_back(str(start, "is now a ", layer.type()));
    } else if (const auto param = proposal_of(layer); param && !(is_python && keep_python)) {
      if (is_python) layer.set_type("Proposal");
      *layer.mutable_proposal_param() = *param;
      warnings.push_back(str(
          start, is_python ? "is now a Proposal. " : "has no proposal_param. ",
          "Settings that the file lacks are py-faster-rcnn's: pre_nms_topn 6000, ",
          "post_nms_topn 300, nms_thresh 0.7, min_size 16 (config.py), base_size 16 and, unless ",
          "param_str has them, ratio ", joined(param->ratio(), " "), " and scale ",
          joined(param->scale(), " "), " (generate_anchors.py); if yours differ, write a ",
          "Proposal layer with proposal_param in its place"));
    }
    result.add_layer()->Swap(&layer);
  }
  net.mutable_layer()->Swap(result.mutable_layer());
}

void widen_inputs(caffe::NetParameter& net, std::vector<std::string>& warnings) {
  std::map<std::string, caffe::BlobShape*> shapes;
  for (caffe::LayerParameter& layer : *net.mutable_layer()) {
    const bool pools = layer.type() == "ROIPooling" || layer.type() == "PSROIPooling";
    const bool proposes = layer.type() == "Proposal" && layer.bottom_size() == 3;
    const int64_t wanted = pools ? 5 : 3;  // image, x1, y1, x2, y2; height, width, scale
    for (int i = pools ? 1 : 2; (pools || proposes) && i < layer.bottom_size(); ++i) {
      const auto found = shapes.find(layer.bottom(i));
      if (found == shapes.end() || found->second->dim_size() != 2 ||
          found->second->dim(1) != wanted - 1)
        continue;
      found->second->set_dim(1, wanted);
      warnings.push_back(str("input '", found->first, "' has ", wanted, " numbers in a row, not ",
                             wanted - 1, ", because layer '", layer.name(), "' (", layer.type(),
                             ") reads as many"));
    }
    for (const std::string& top : layer.top()) shapes.erase(top);
    const int n = layer.type() == "Input" ? layer.input_param().shape_size() : 0;
    for (int i = 0; i < std::min(n, layer.top_size()); ++i)
      shapes[layer.top(i)] = layer.mutable_input_param()->mutable_shape(i);
  }
}

}  // namespace revisit::proto
