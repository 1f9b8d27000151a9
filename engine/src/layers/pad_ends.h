#pragma once

#include <array>
#include <cstdint>
#include <optional>

#include "revisit/base/error.h"

namespace revisit::engine {

/// Trailing pads along rows and columns, pad_b and pad_r, if they differ from pad_h and pad_w, the
/// leading ones. Throws InputError for pad_l, pad_r, pad_t, pad_b that the upgrade left because of
/// another pad.
template <class Param>
std::optional<std::array<int64_t, 2>> pad_ends(const Param& param) {
  const bool has_ends = param.has_pad_b() && param.has_pad_r();
  if (param.has_pad_l() || param.has_pad_t() || param.has_pad_b() != param.has_pad_r() ||
      (has_ends && !(param.has_pad_h() && param.has_pad_w())))
    throw InputError("give pad, or pad_h and pad_w, or pad_l, pad_r, pad_t and pad_b");
  if (!has_ends) return std::nullopt;
  return std::array<int64_t, 2>{param.pad_b(), param.pad_r()};
}

}  // namespace revisit::engine
