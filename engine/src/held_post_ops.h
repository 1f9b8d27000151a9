#pragma once

#include <memory>

#include "aligned.h"
#include "kernels/post_ops.h"
#include "layer.h"

namespace revisit::engine {

/// Scale and shift as kernels on blocked values want them.
struct HeldAffine {
  std::shared_ptr<const AlignedFloats> scale, shift;

  explicit HeldAffine(const ChannelAffine& affine)
      : scale(hold(affine.scale)), shift(hold(affine.shift)) {}

 private:
  static std::shared_ptr<const AlignedFloats> hold(const std::vector<double>& values) {
    const int64_t lanes = padded_channels(static_cast<int64_t>(values.size()));
    return std::make_shared<const AlignedFloats>(padded(values, lanes));
  }
};

/// What is fused to a kernel on plain values that cannot do it: done afterwards, in place.
class HeldPostOps {
 public:
  explicit HeldPostOps(const Binding& binding)
      : adds_(binding.fusion.adds_last_input),
        threads_(binding.threads),
        activation_(binding.fusion.activation) {
    const Shape& shape = binding.outputs[0];
    runs_ = shape.rank() < 2 ? ChannelRuns{1, 1, shape.elements()}
                             : ChannelRuns{shape[0], shape[1], shape.product(2, shape.rank())};
    if (binding.fusion.affine) affine_ = HeldAffine(*binding.fusion.affine);
  }

  void operator()(const float* last_input, float* values) const {
    apply({affine_ ? affine_->scale->data() : nullptr, affine_ ? affine_->shift->data() : nullptr,
           adds_ ? last_input : nullptr, activation_.epilogue},
          runs_, threads_, values);
  }

 private:
  ChannelRuns runs_;
  bool adds_;
  int threads_;
  Activating activation_;
  std::optional<HeldAffine> affine_;
};

}  // namespace revisit::engine
