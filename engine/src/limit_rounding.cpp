#include <algorithm>

#include "fuse.h"

namespace revisit::engine {

// docs/ACCURACY.md has the errors of real nets for both limits, and for none.
void limit_rounding(Accuracy accuracy, Operations* operations) {
  constexpr int kLittleRounding = 6;
  std::vector<bool> amplified(operations->held_by.size(), false);  // of each value: later on
  for (auto operation = operations->list.rbegin(); operation != operations->list.rend();
       ++operation) {
    const bool later = std::any_of(operation->outputs.begin(), operation->outputs.end(),
                                   [&](ValueId id) { return amplified[operations->held_by[id]]; });
    if (later || accuracy == Accuracy::kStrict) operation->most_winograd_points = kLittleRounding;
    if (later || operation->layer->amplifies_rounding())
      for (const ValueId id : operation->inputs) amplified[id] = true;
  }
}

}  // namespace revisit::engine
