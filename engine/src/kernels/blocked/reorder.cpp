#include "kernels/blocked/kernels.h"
#include "kernels/blocked/partition.h"

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
struct PlanePiece {
  int64_t channels, pixels, plain;
};

PlanePiece piece_of(const BlockedSize& size, int64_t block, int64_t begin, int64_t end) {
  const int64_t plane = begin / kLanes / size.pixels, image = plane / channel_blocks(size.c);
  const int64_t first = begin / kLanes % size.pixels;
  return {std::min(size.c - block * kLanes, kLanes), (end - begin) / kLanes,
          (image * size.c + block * kLanes) * size.pixels + first};
}

void write_blocks(const PlanePiece& piece, int64_t pixels, const float* plain, float* blocked) {
  transpose(piece.channels, piece.pixels, plain, pixels, blocked, kLanes);
}

void write_plain(const PlanePiece& piece, int64_t pixels, const float* blocked, float* plain) {
  transpose(piece.pixels, piece.channels, blocked, kLanes, plain, pixels);
}

/// Calls `work(first pixel, part)` for kFew pixels of a piece at a time.
template <class Work>
void for_each_few(const PlanePiece& piece, const Work& work) {
  for (int64_t first = 0; first < piece.pixels; first += kFew)
    work(first, PlanePiece{piece.channels, std::min(kFew, piece.pixels - first), 0});
}

template <class T>
void write_blocks(const PlanePiece& piece, int64_t pixels, const float* plain, T* blocked) {
  HWY_ALIGN float few[kFew * kLanes] = {};
  for_each_few(piece, [&](int64_t first, const PlanePiece& part) HWY_ATTR {
    write_blocks(part, pixels, plain + first, few);
    for (int64_t i = 0; i < part.pixels * kLanes; i += kLanes)
      store_block(load_block(few + i), blocked + first * kLanes + i);
  });
}

template <class T>
void write_plain(const PlanePiece& piece, int64_t pixels, const T* blocked, float* plain) {
  HWY_ALIGN float few[kFew * kLanes];
  for_each_few(piece, [&](int64_t first, const PlanePiece& part) HWY_ATTR {
    for (int64_t i = 0; i < part.pixels * kLanes; i += kLanes)
      store_block(load_block(blocked + first * kLanes + i), few + i);
    write_plain(part, pixels, few, plain + first);
  });
}

template <class T>
void all_to_blocked(const BlockedSize& size, const float* plain, T* blocked) {
  for_each_piece(size, [&](int64_t block, int64_t begin, int64_t end) HWY_ATTR {
    const PlanePiece piece = piece_of(size, block, begin, end);
    write_blocks(piece, size.pixels, plain + piece.plain, blocked + begin);
    clear_tail_lanes(size.c, block, piece.pixels, blocked + begin);
  });
}

template <class T>
void all_to_plain(const BlockedSize& size, const T* blocked, float* plain) {
  for_each_piece(size, [&](int64_t block, int64_t begin, int64_t end) HWY_ATTR {
    const PlanePiece piece = piece_of(size, block, begin, end);
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

namespace {

/// A vector of the input and the mapping of its lanes to a vector of the output.
template <class T>
struct Part {
  const T* from;
  HWY_ALIGN int32_t lanes[kVectorLanes];
  HWY_ALIGN float taken[kVectorLanes];  // 1 or 0
};

/// Parts per pass, limited by registers.
constexpr int64_t kMost = 4;

template <class T>
struct Parts {
  Part<T> parts[std::max(kVectorLanes, kMost)];
  int64_t count = 0;

  Part<T>& from(const T* vector) {
    for (int64_t k = 0; k < count; ++k)
      if (parts[k].from == vector) return parts[k];
    return parts[count++] = {vector, {}, {}};
  }
};

/// Starts at the first pixel of `image`, whose blocks are `step` numbers apart.
template <class T>
Parts<T> parts_of(std::span<const int64_t> sources, const T* image, int64_t step) {
  Parts<T> result;
  for (size_t lane = 0; lane < sources.size(); ++lane) {
    const int64_t in_block = sources[lane] % kLanes;
    Part<T>& part =
        result.from(image + sources[lane] / kLanes * step + in_block / kVectorLanes * kVectorLanes);
    part.lanes[lane] = static_cast<int32_t>(in_block % kVectorLanes);
    part.taken[lane] = 1;
  }
  return result;
}

/// Adds parts to a vector for `pixels` pixels; `first` starts from zero.
template <int kParts, class T>
void put(const Part<T>* parts, bool first, int64_t pixels, T* output) {
  const Tag d;
  decltype(hn::SetTableIndices(d, parts->lanes)) lanes[kParts];
  hn::Mask<Tag> taken[kParts];
  const T* from[kParts];
  REVISIT_UNROLL
  for (int k = 0; k < kParts; ++k) {
    lanes[k] = hn::SetTableIndices(d, parts[k].lanes);
    taken[k] = hn::Gt(hn::Load(d, parts[k].taken), hn::Zero(d));
    from[k] = parts[k].from;
  }
  for (int64_t i = 0; i < pixels * kLanes; i += kLanes) {
    Vector sum = first ? hn::Zero(d) : load_vector(output + i);
    REVISIT_UNROLL
    for (int k = 0; k < kParts; ++k)
      sum = hn::IfThenElse(taken[k], hn::TableLookupLanes(load_vector(from[k] + i), lanes[k]), sum);
    store_vector(sum, output + i);
  }
}

template <class T>
void put_all(const Parts<T>& parts, int64_t pixels, T* output) {
  for (int64_t k = 0; k < parts.count; k += kMost) {
    const Part<T>* const next = parts.parts + k;
    switch (std::min(parts.count - k, kMost)) {
      case 1:
        put<1>(next, k == 0, pixels, output);
        break;
      case 2:
        put<2>(next, k == 0, pixels, output);
        break;
      case 3:
        put<3>(next, k == 0, pixels, output);
        break;
      default:
        put<4>(next, k == 0, pixels, output);
    }
  }
}

template <class T>
void shuffle_all(const BlockedSize& size, std::span<const int64_t> sources, const T* input,
                 T* output) {
  const int64_t step = size.pixels * kLanes, blocks = channel_blocks(size.c);
  for_each_piece(size, [&](int64_t block, int64_t begin, int64_t end) HWY_ATTR {
    const int64_t image = begin / step / blocks;
    for (int64_t lane = 0; lane < kLanes; lane += kVectorLanes) {
      const int64_t first = std::min(block * kLanes + lane, size.c);
      put_all(parts_of(sources.subspan(first, std::min(kVectorLanes, size.c - first)),
                       input + image * blocks * step + begin % step, step),
              (end - begin) / kLanes, output + begin + lane);
    }
    clear_tail_lanes(size.c, block, (end - begin) / kLanes, output + begin);
  });
}

}  // namespace

void shuffle_channels(const BlockedSize& size, std::span<const int64_t> sources, const void* input,
                      void* output) {
  with_type(size.values, [&](auto type) {
    using T = decltype(type);
    shuffle_all(size, sources, static_cast<const T*>(input), static_cast<T*>(output));
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

HWY_EXPORT(shuffle_channels);

void blocked_shuffle(const BlockedSize& size, std::span<const int64_t> sources, const void* input,
                     void* output) {
  REVISIT_DISPATCH(shuffle_channels, instructions_for(size.values))(size, sources, input, output);
}

}  // namespace revisit::engine
#endif
