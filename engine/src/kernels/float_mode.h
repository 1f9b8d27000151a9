#pragma once

#include <cstdint>

#ifdef __SSE__
#include <xmmintrin.h>
#endif

namespace revisit::engine {

/// Register MXCSR on x86, FPCR on 64-bit ARM; unsupported elsewhere.
class FloatMode {
 public:
  static FloatMode current() {
#if defined(__SSE__)
    return FloatMode(_mm_getcsr());
#elif defined(__aarch64__)
    uint64_t bits = 0;
    asm volatile("mrs %0, fpcr" : "=r"(bits));
    return FloatMode(bits);
#else
    return FloatMode(0);
#endif
  }

  /// Returns this mode with denormal operands and results treated as zero.
  FloatMode flushing_denormals() const {
#if defined(__SSE__)
    constexpr uint64_t kFlushToZero = 0x8000, kDenormalsAreZeros = 0x0040;
    return FloatMode(bits_ | kFlushToZero | kDenormalsAreZeros);
#elif defined(__aarch64__)
    return FloatMode(bits_ | uint64_t{1} << 24);
#else
    return *this;
#endif
  }

  void set() const {
#if defined(__SSE__)
    _mm_setcsr(static_cast<unsigned>(bits_));
#elif defined(__aarch64__)
    asm volatile("msr fpcr, %0" : : "r"(bits_));
#endif
  }

 private:
  explicit FloatMode(uint64_t bits) : bits_(bits) {}
  uint64_t bits_;
};

class FloatModeScope {
 public:
  explicit FloatModeScope(FloatMode mode) : before_(FloatMode::current()) { mode.set(); }
  ~FloatModeScope() { before_.set(); }
  FloatModeScope(const FloatModeScope&) = delete;
  FloatModeScope& operator=(const FloatModeScope&) = delete;

 private:
  FloatMode before_;
};

}  // namespace revisit::engine
