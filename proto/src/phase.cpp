#include "phase.h"

#include <algorithm>

#include "revisit/base/error.h"

namespace revisit::proto {
namespace {

/// Caffe's StateMeetsRule: every condition that is set must hold.
bool meets(const caffe::NetState& state, const caffe::NetStateRule& rule) {
  const auto has_stage = [&](const std::string& stage) {
    return std::find(state.stage().begin(), state.stage().end(), stage) != state.stage().end();
  };
  if (rule.has_phase() && rule.phase() != state.phase()) return false;
  if (rule.has_min_level() && state.level() < rule.min_level()) return false;
  if (rule.has_max_level() && state.level() > rule.max_level()) return false;
  return std::all_of(rule.stage().begin(), rule.stage().end(), has_stage) &&
         std::none_of(rule.not_stage().begin(), rule.not_stage().end(), has_stage);
}

bool included(const caffe::NetState& state, const caffe::LayerParameter& layer) {
  const auto met = [&](const caffe::NetStateRule& rule) { return meets(state, rule); };
  if (layer.include_size() > 0 && layer.exclude_size() > 0)
    throw InputError("layer '", layer.name(), "': give include or exclude rules, not both");
  if (layer.include_size() > 0)
    return std::any_of(layer.include().begin(), layer.include().end(), met);
  return std::none_of(layer.exclude().begin(), layer.exclude().end(), met);
}

}  // namespace

void keep_test_phase(caffe::NetParameter& net) {
  caffe::NetState state = net.state();
  state.set_phase(caffe::TEST);
  auto& layers = *net.mutable_layer();
  layers.erase(std::remove_if(layers.begin(), layers.end(),
                              [&](const auto& layer) { return !included(state, layer); }),
               layers.end());
}

}  // namespace revisit::proto
