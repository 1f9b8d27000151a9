#pragma once

#include <atomic>
#include <cstdint>
#include <cstdlib>
#include <new>

/// Counts every operator new of the program; include it in one file only.
namespace revisit::test {
inline std::atomic<int64_t> allocations{0};
}  // namespace revisit::test

// Sanitizers have their own operator new.
#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
// noinline, because g++ otherwise warns about free() of memory from new.
[[gnu::noinline]] void* operator new(size_t bytes) {
  ++revisit::test::allocations;
  if (void* memory = std::malloc(bytes > 0 ? bytes : 1)) return memory;
  throw std::bad_alloc();
}
[[gnu::noinline]] void operator delete(void* memory) noexcept {
  std::free(memory);
}
[[gnu::noinline]] void operator delete(void* memory, size_t) noexcept {
  std::free(memory);
}
#endif
