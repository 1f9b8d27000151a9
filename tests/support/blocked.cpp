#include "blocked.h"

#include <cstdlib>
#include <cstring>
#include <utility>

namespace revisit::test {
namespace {

constexpr size_t kAlignment = 64;

size_t index_of(int64_t n, int64_t c, int64_t pixel, int64_t channels, int64_t pixels) {
  const int64_t block = n * engine::channel_blocks(channels) + c / engine::kLanes;
  return static_cast<size_t>((block * pixels + pixel) * engine::kLanes + c % engine::kLanes);
}

template <class Work>
void for_each_element(int64_t n, int64_t c, int64_t pixels, const Work& work) {
  size_t plain = 0;
  for (int64_t i = 0; i < n; ++i)
    for (int64_t j = 0; j < c; ++j)
      for (int64_t p = 0; p < pixels; ++p) work(plain++, index_of(i, j, p, c, pixels));
}

}  // namespace

AlignedFloats::AlignedFloats(int64_t count, unsigned char byte)
    : size_(static_cast<size_t>(count)) {
  const size_t bytes = (size_ * sizeof(float) + kAlignment - 1) / kAlignment * kAlignment;
  data_ = static_cast<float*>(std::aligned_alloc(kAlignment, bytes ? bytes : kAlignment));
  std::memset(data_, byte, size_ * sizeof(float));
}

AlignedFloats::AlignedFloats(AlignedFloats&& other) noexcept
    : data_(std::exchange(other.data_, nullptr)), size_(std::exchange(other.size_, 0)) {}

AlignedFloats::~AlignedFloats() {
  std::free(data_);
}

AlignedFloats to_blocked(int64_t n, int64_t c, int64_t pixels, std::span<const float> plain) {
  AlignedFloats blocked(n * engine::padded_channels(c) * pixels, 0);
  for_each_element(n, c, pixels, [&](size_t from, size_t to) { blocked.data()[to] = plain[from]; });
  return blocked;
}

std::vector<float> to_plain(int64_t n, int64_t c, int64_t pixels, std::span<const float> blocked) {
  std::vector<float> plain(static_cast<size_t>(n * c * pixels));
  for_each_element(n, c, pixels, [&](size_t to, size_t from) { plain[to] = blocked[from]; });
  return plain;
}

AlignedFloats rounded_to_bf16(const AlignedFloats& blocked) {
  AlignedFloats result(static_cast<int64_t>(blocked.values().size()) / 2, 0);
  auto* to = reinterpret_cast<engine::BFloat16*>(result.data());
  for (const float x : blocked.values()) *to++ = engine::to_bfloat16(x);
  return result;
}

AlignedFloats widened(const AlignedFloats& bf16) {
  AlignedFloats result(static_cast<int64_t>(bf16.values().size()) * 2, 0);
  const auto* from = reinterpret_cast<const engine::BFloat16*>(bf16.data());
  for (int64_t i = 0; i < static_cast<int64_t>(result.values().size()); ++i)
    result.data()[i] = engine::to_float(from[i]);
  return result;
}

int64_t find_dirty_tail(int64_t n, int64_t c, int64_t pixels, std::span<const float> blocked) {
  for (int64_t i = 0; i < n; ++i)
    for (int64_t j = c; j < engine::padded_channels(c); ++j)
      for (int64_t p = 0; p < pixels; ++p) {
        const size_t at = index_of(i, j, p, c, pixels);
        if (!(blocked[at] == 0)) return static_cast<int64_t>(at);
      }
  return -1;
}

}  // namespace revisit::test
