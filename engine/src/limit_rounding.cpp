#include <algorithm>

#include "fuse.h"

namespace revisit::engine {

// docs/ACCURACY.md has the rule, and errors of nets with and without it.
std::vector<bool> sensitive_values(const Graph& graph) {
  struct Later {
    bool amplified = false, compared = false;
  };
  std::vector<Later> later(graph.values.size());
  for (auto node = graph.nodes.rbegin(); node != graph.nodes.rend(); ++node) {
    if (!node->layer) continue;
    Later of_outputs;
    for (const ValueId id : node->outputs) {
      of_outputs.amplified |= later[id].amplified;
      of_outputs.compared |= later[id].compared;
    }
    const Rounding rounding = node->layer->rounding();
    const bool is_view = node->layer->output_memory() == OutputMemory::kViewOfInput;
    for (const ValueId id : node->inputs) {
      if (is_view && id != node->inputs[0]) continue;  // further inputs only define the shape
      later[id].amplified |= of_outputs.amplified || rounding == Rounding::kAmplified;
      later[id].compared |= (of_outputs.compared && rounding != Rounding::kAveraged) ||
                            rounding == Rounding::kCompared;
    }
  }
  std::vector<bool> sensitive;
  for (const Later& value : later) sensitive.push_back(value.amplified || value.compared);
  return sensitive;
}

void limit_rounding(bool strict, const std::vector<bool>& sensitive, Operations* operations) {
  constexpr int kLittleRounding = 6;
  for (Operation& operation : operations->list)
    if (strict || std::ranges::any_of(operation.outputs, [&](ValueId id) { return sensitive[id]; }))
      operation.max_winograd_points = kLittleRounding;
}

}  // namespace revisit::engine
