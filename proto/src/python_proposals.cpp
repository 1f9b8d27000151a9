#include <charconv>
#include <cmath>
#include <map>
#include <optional>
#include <string_view>

#include "revisit/base/error.h"
#include "revisit/base/text.h"
#include "upgrade.h"

namespace revisit::proto {
namespace {

using Numbers = std::vector<float>;
using Parameters = std::map<std::string_view, Numbers>;

/// Parses the subset of YAML in such layers: quoted keys with numbers or lists of numbers, in
/// braces or one per line.
class ParamStr {
 public:
  explicit ParamStr(std::string_view text)
      : rest_(text.substr(0, text.find_last_not_of(" \n") + 1)) {}

  std::optional<Parameters> parse() {
    Parameters all;
    const bool braces = accept("{");
    do {
      const std::string_view key = quoted();
      Numbers value;
      if (key.empty() || !accept(":") || !parse_value(value) || !all.emplace(key, value).second)
        return std::nullopt;
    } while (braces ? accept(",") : accept("\n"));
    if ((braces && !accept("}")) || !rest_.empty()) return std::nullopt;
    return all;
  }

 private:
  bool accept(std::string_view token) {
    while (rest_.starts_with(' ')) rest_.remove_prefix(1);
    if (!rest_.starts_with(token)) return false;
    rest_.remove_prefix(token.size());
    while (rest_.starts_with(' ')) rest_.remove_prefix(1);
    return true;
  }

  std::string_view quoted() {
    const char* quote = accept("'") ? "'" : accept("\"") ? "\"" : nullptr;
    const size_t end = quote ? rest_.find(*quote) : std::string_view::npos;
    if (end == std::string_view::npos) return {};
    const std::string_view text = rest_.substr(0, end);
    rest_.remove_prefix(end + 1);
    return text;
  }

  bool parse_value(Numbers& value) {
    accept("!!python/tuple");
    if (!accept("[")) return parse_number(value);
    do {
      if (!value.empty() && accept("]")) return true;  // trailing comma
      if (!parse_number(value)) return false;
    } while (accept(","));
    return accept("]");
  }

  bool parse_number(Numbers& value) {
    float number = 0;
    const auto [end, error] = std::from_chars(rest_.data(), rest_.data() + rest_.size(), number);
    if (error != std::errc()) return false;
    rest_.remove_prefix(end - rest_.data());
    value.push_back(number);
    accept("");
    return true;
  }

  std::string_view rest_;
};

/// Parameters of a ProposalLayer with `scales`, or of sanghoon/pva-faster-rcnn's with `ratios`,
/// too; nullopt for any other layer.
std::optional<caffe::ProposalParameter> proposal_of(const caffe::LayerParameter& layer) {
  const caffe::PythonParameter& python = layer.python_param();
  if (layer.type() != "Python" || python.module() != "rpn.proposal_layer" ||
      python.layer() != "ProposalLayer" || (layer.has_phase() && layer.phase() == caffe::TRAIN) ||
      layer.bottom_size() != 3 || layer.top_size() < 1 || layer.top_size() > 2)
    return std::nullopt;
  auto given = ParamStr(python.param_str()).parse();
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

}  // namespace

void replace_python_proposals(caffe::NetParameter& net, std::vector<std::string>& warnings) {
  for (caffe::LayerParameter& layer : *net.mutable_layer()) {
    const auto param = proposal_of(layer);
    if (!param) continue;
    layer.set_type("Proposal");
    *layer.mutable_proposal_param() = *param;
    warnings.push_back(
        str("layer '", layer.name(), "' (Python: ProposalLayer) is now a Proposal. ",
            "Settings that the file lacks are py-faster-rcnn's: pre_nms_topn 6000, ",
            "post_nms_topn 300, nms_thresh 0.7, min_size 16 (config.py), base_size 16 and, unless ",
            "param_str has them, ratio ", joined(param->ratio(), " "), " and scale ",
            joined(param->scale(), " "), " (generate_anchors.py); if yours differ, write a ",
            "Proposal layer with proposal_param in its place"));
  }
}

}  // namespace revisit::proto
