#include "aligned.h"

#ifdef __linux__
#include <sys/mman.h>
#endif

#include <new>

namespace revisit::engine {
namespace {

constexpr size_t kCacheLine = 64, kHugePage = size_t{2} << 20;
constexpr size_t kFromHugePages = 2 * kHugePage;  // smaller sizes would waste too much

}  // namespace

AlignedFloats::AlignedFloats(int64_t size) : size_(size) {
  const size_t floats = static_cast<size_t>(size) * sizeof(float);
  const size_t alignment = floats < kFromHugePages ? kCacheLine : kHugePage;
  const size_t bytes = (floats / alignment + 1) * alignment;
  data_.reset(static_cast<float*>(std::aligned_alloc(alignment, bytes)));
  if (!data_) throw std::bad_alloc();
#ifdef MADV_HUGEPAGE
  // With 4 KiB pages, a net of 512 channels spends 5 % of its time on address translation, because
  // weights are streamed and strips are far apart. Systems without huge pages ignore the request.
  if (alignment == kHugePage) madvise(data_.get(), bytes, MADV_HUGEPAGE);
#endif
}

}  // namespace revisit::engine
