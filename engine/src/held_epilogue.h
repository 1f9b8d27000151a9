#pragma once

#include <memory>

#include "aligned.h"
#include "form.h"
#include "layout.h"

namespace revisit::engine {

/// An activation with the slopes that its epilogue points to.
struct HeldEpilogue {
  Epilogue epilogue;
  std::shared_ptr<const AlignedFloats> slopes;

  explicit HeldEpilogue(const Activating& activation) : epilogue(activation.epilogue) {
    const auto channels = static_cast<int64_t>(activation.slopes.size());
    if (channels == 0) return;
    slopes =
        std::make_shared<const AlignedFloats>(padded(activation.slopes, padded_channels(channels)));
    epilogue.slopes = slopes->data();
  }
};

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

}  // namespace revisit::engine
