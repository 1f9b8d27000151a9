#pragma once

#include <atomic>
#include <cstdint>
#include <cstdlib>
#include <new>

/// Counts every operator new of the program that includes it, in one file.
namespace revisit::test {
inline std::atomic<int64_t> allocations{0};
}  // namespace revisit::test

// With a sanitizer operator new is its own and stays so.
#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
// Not inlined: else g++ sees free() meet memory of new.
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
