#pragma once

#ifdef __SANITIZE_THREAD__
extern "C" void __tsan_acquire(void*);
extern "C" void __tsan_release(void*);
#endif

namespace revisit::engine {

/// Tells the thread sanitizer what libgomp, which is built without it, does at the two ends of a
/// parallel region: to be made before it, with a call before and after the work of each thread, or
/// each item of it. Inside a region it sees races as usual. Nothing in other builds.
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

}  // namespace revisit::engine
