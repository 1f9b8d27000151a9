#include <sys/mman.h>

#include <algorithm>
#include <mutex>
#include <new>
#include <vector>

#include "revisit/engine/blas.h"

namespace revisit::engine {
namespace {

struct Held {
  std::mutex mutex;
  int now = 0, most = 0;  // buffers
};

Held& held() {
  static Held all;
  return all;
}

/// Whether `count` buffers could be mapped, one by one as OpenBLAS maps them.
bool can_be_mapped(int count) {
  constexpr size_t kBytes = (size_t{128} << 20) + 4096;  // OpenBLAS takes at most this for one
  std::vector<void*> buffers;
  while (static_cast<int>(buffers.size()) < count) {
    void* const buffer =
        ::mmap(nullptr, kBytes, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    if (buffer == MAP_FAILED) break;
    buffers.push_back(buffer);
  }
  for (void* const buffer : buffers) ::munmap(buffer, kBytes);
  return static_cast<int>(buffers.size()) == count;
}

}  // namespace

BlasRoom::BlasRoom(int threads) : threads_(threads) {
  Held& all = held();
  const std::scoped_lock lock(all.mutex);
  // OpenBLAS keeps its buffers: up to the most so far there is room. Which of them it has mapped by
  // now is not known, so all are asked for.
  if (all.now + threads > all.most && !can_be_mapped(all.now + threads)) throw std::bad_alloc();
  all.now += threads;
  all.most = std::max(all.most, all.now);
}

BlasRoom::~BlasRoom() {
  Held& all = held();
  const std::scoped_lock lock(all.mutex);
  all.now -= threads_;
}

}  // namespace revisit::engine
