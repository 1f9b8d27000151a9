#include "fuse.h"

namespace revisit::engine {

// docs/ACCURACY.md has the rule, and errors of nets with and without it.
void limit_rounding(Accuracy accuracy, Operations* operations) {
  constexpr int kLittleRounding = 6;
  struct Later {
    bool amplified = false, compared = false;
  };
  std::vector<Later> later(operations->held_by.size());
  for (auto operation = operations->list.rbegin(); operation != operations->list.rend();
       ++operation) {
    Later of_outputs;
    for (const ValueId id : operation->outputs) {
      const Later& value = later[operations->held_by[id]];
      of_outputs.amplified |= value.amplified;
      of_outputs.compared |= value.compared;
    }
    if (of_outputs.amplified || of_outputs.compared || accuracy == Accuracy::kStrict)
      operation->max_winograd_points = kLittleRounding;
    const Rounding rounding = operation->layer.get().rounding();
    for (const ValueId id : operation->inputs) {
      later[id].amplified |= of_outputs.amplified || rounding == Rounding::kAmplified;
      later[id].compared |= (of_outputs.compared && rounding != Rounding::kAveraged) ||
                            rounding == Rounding::kCompared;
    }
  }
}

}  // namespace revisit::engine
