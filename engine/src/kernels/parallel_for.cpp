#include "revisit/engine/parallel_for.h"

#include <omp.h>
#include <pthread.h>

#include <array>
#include <atomic>
#include <exception>
#include <mutex>

#include "kernels/float_mode.h"
#include "layout.h"

#ifdef __SANITIZE_THREAD__
extern "C" void __tsan_acquire(void*);
extern "C" void __tsan_release(void*);
#endif

namespace revisit::engine {
namespace {

/// Ends OpenMP's threads of the calling thread before fork(), which recreates them on demand.
/// Otherwise the child, which lacks them, would wait forever.
[[maybe_unused]] const bool kThreadsEndAtFork =
    ::pthread_atfork([] { omp_pause_resource_all(omp_pause_soft); }, nullptr, nullptr) == 0;

/// Reports the synchronization of a parallel region to ThreadSanitizer, because libgomp is built
/// without it. Must be created before the region and called before and after the work of each
/// thread.
struct RegionForSanitizer {
#ifdef __SANITIZE_THREAD__
  char begun = 0, done = 0;
  RegionForSanitizer() {
    __tsan_release(&begun);
  }
  ~RegionForSanitizer() {
    __tsan_acquire(&done);
  }
  void enter() {
    __tsan_acquire(&begun);
  }
  void leave() {
    __tsan_release(&done);
  }
#else
  void enter() {}
  void leave() {}
#endif
};

}  // namespace

void share_items(int64_t items, int threads,
                 void (*work)(const void* object, int64_t item, int thread), const void* object) {
  if (items <= 1) {
    if (items == 1) work(object, 0, 0);
    return;
  }
  const FloatMode mode = FloatMode::current();
  constexpr int kMaxRanges = 64;  // further threads share them
  const int64_t parts = std::min<int64_t>(items, std::min(threads, kMaxRanges));
  struct alignas(64) Range {  // one cache line each
    std::atomic<int64_t> next;
  };
  std::array<Range, kMaxRanges> own;
  for (int64_t i = 0; i < parts; ++i) own[i].next = Split{items, parts}.begin(i);
  std::atomic<int64_t> failed = items;  // lowest item that threw
  std::exception_ptr error;
  std::mutex mutex;
  {
    RegionForSanitizer region;
#pragma omp parallel num_threads(threads)
    {
      region.enter();
      const FloatModeScope scope(mode);
      const int thread = omp_get_thread_num();
      for (int64_t i = 0; i < parts; ++i) {
        const int64_t range = (thread + i) % parts;
        const int64_t end = Split{items, parts}.end(range);
        std::atomic<int64_t>& next = own[range].next;
        for (int64_t item; (item = next.fetch_add(1, std::memory_order_relaxed)) < end;) {
          if (item > failed.load(std::memory_order_relaxed)) break;
          try {
            work(object, item, thread);
          } catch (...) {
            const std::scoped_lock lock(mutex);
            if (item > failed) continue;
            failed = item;
            error = std::current_exception();
          }
        }
      }
      region.leave();
    }
  }
  if (error) std::rethrow_exception(error);
}

}  // namespace revisit::engine
