#include "kernels/blocked/reorder.h"

#include "kernels/blocked/blocked_pieces.h"
#include "kernels/blocked/dispatch.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "kernels/blocked/reorder.cpp"
#include <hwy/foreach_target.h>
// After foreach_target.h.
#include "kernels/blocked/block-inl.h"
#include "kernels/transpose-inl.h"

HWY_BEFORE_NAMESPACE();
namespace revisit::engine::HWY_NAMESPACE {
namespace {

constexpr int64_t kFew = 64;

/// Part of a plane: its size, and the offset of its first channel in the NCHW value.
struct Piece {
  int64_t channels, pixels, plain;
};

Piece piece_of(const BlockedSize& size, int64_t block, int64_t begin, int64_t end) {
  const int64_t plane = begin / kLanes / size.pixels, image = plane / channel_blocks(size.c);
  const int64_t first = begin / kLanes % size.pixels;
  return {std::min(size.c - block * kLanes, kLanes), (end - begin) / kLanes,
          (image * size.c + block * kLanes) * size.pixels + first};
}

void write_blocks(const Piece& piece, int64_t pixels, const float* plain, float* blocked) {
  transpose(piece.channels, piece.pixels, plain, pixels, blocked, kLanes);
}

void write_plain(const Piece& piece, int64_t pixels, const float* blocked, float* plain) {
  transpose(piece.pixels, piece.channels, blocked, kLanes, plain, pixels);
}

/// Calls `work(first pixel, part)` for kFew pixels of a piece at a time.
template <class Work>
void for_each_few(const Piece& piece, const Work& work) {
  for (int64_t first = 0; first < piece.pixels; first += kFew)
    work(first, Piece{piece.channels, std::min(kFew, piece.pixels - first), 0});
}

template <class T>
void write_blocks(const Piece& piece, int64_t pixels, const float* plain, T* blocked) {
  HWY_ALIGN float few[kFew * kLanes] = {};
  for_each_few(piece, [&](int64_t first, const Piece& part) HWY_ATTR {
    write_blocks(part, pixels, plain + first, few);
    for (int64_t i = 0; i < part.pixels * kLanes; i += kLanes)
      store_block(load_block(few + i), blocked + first * kLanes + i);
  });
}

template <class T>
void write_plain(const Piece& piece, int64_t pixels, const T* blocked, float* plain) {
  HWY_ALIGN float few[kFew * kLanes];
  for_each_few(piece, [&](int64_t first, const Piece& part) HWY_ATTR {
    for (int64_t i = 0; i < part.pixels * kLanes; i += kLanes)
      store_block(load_block(blocked + first * kLanes + i), few + i);
    write_plain(part, pixels, few, plain + first);
  });
}

template <class T>
void all_to_blocked(const BlockedSize& size, const float* plain, T* blocked) {
  for_each_piece(size, [&](int64_t block, int64_t begin, int64_t end) HWY_ATTR {
    const Piece piece = piece_of(size, block, begin, end);
    write_blocks(piece, size.pixels, plain + piece.plain, blocked + begin);
    clear_tail_lanes(size.c, block, piece.pixels, blocked + begin);
  });
}

template <class T>
void all_to_plain(const BlockedSize& size, const T* blocked, float* plain) {
  for_each_piece(size, [&](int64_t block, int64_t begin, int64_t end) HWY_ATTR {
    const Piece piece = piece_of(size, block, begin, end);
    write_plain(piece, size.pixels, blocked + begin, plain + piece.plain);
  });
}

}  // namespace

void to_blocked(const BlockedSize& size, const float* plain, void* blocked) {
  with_type(size.values,
            [&](auto type) { all_to_blocked(size, plain, static_cast<decltype(type)*>(blocked)); });
}

void to_plain(const BlockedSize& size, const void* blocked, float* plain) {
  with_type(size.values, [&](auto type) {
    all_to_plain(size, static_cast<const decltype(type)*>(blocked), plain);
  });
}

}  // namespace revisit::engine::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace revisit::engine {

HWY_EXPORT(to_blocked);
HWY_EXPORT(to_plain);

void reorder_to_nchwc(const BlockedSize& size, const float* plain, void* blocked) {
  REVISIT_DISPATCH(to_blocked, instructions_for(size.values))(size, plain, blocked);
}

void reorder_to_nchw(const BlockedSize& size, const void* blocked, float* plain) {
  REVISIT_DISPATCH(to_plain, instructions_for(size.values))(size, blocked, plain);
}

}  // namespace revisit::engine
#endif
