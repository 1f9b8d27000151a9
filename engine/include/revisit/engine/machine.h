#pragma once

#include <string>

namespace revisit::engine {

/// Returns the instruction set of the engine's kernels on this CPU: "AVX-512", "AVX2", "NEON", ...
std::string simd_target();

/// Returns whether the CPU multiplies bfloat16 natively (AVX512-BF16). Without that,
/// Precision::kBf16 yields the same sums, but its products are slower than in float32.
bool has_bf16_instructions();

/// Returns whether the CPU has bfloat16 tiles (AMX-BF16) and the operating system permits this
/// process to use them. The first call requests the permission.
bool has_bf16_tiles();

/// Returns the bfloat16 instructions of this CPU: "AMX tiles", "AVX512-BF16", or "" if none.
std::string bf16_instructions();

/// Returns the kernel set of OpenBLAS, e.g. "SkylakeX". It is chosen when the library is loaded.
std::string blas_core();

/// Returns a faster kernel set that this CPU supports, or "" if there is none. OpenBLAS falls back
/// to SSE3 kernels on CPUs newer than itself (up to ten times slower), or OPENBLAS_CORETYPE selects
/// a slower set. Set OPENBLAS_CORETYPE to the result before the program starts.
std::string faster_blas_core();

/// Limits OpenBLAS to the calling thread during its lifetime, because the result of a product
/// depends on the number of threads. Every product of the engine runs under one.
///   - OpenBLAS with its own threads (libopenblas0-pthread) has one setting for the process. The
///   first OneBlasThread sets it to one thread permanently. A program that needs more for its own
///   products must call openblas_set_num_threads() afterwards; the engine's results are then equal
///   up to rounding only.
///   - OpenBLAS with OpenMP (libopenblas0-openmp) uses OpenMP's setting of the calling thread,
///   which is set to one and restored. Other threads are not affected.
class OneBlasThread {
 public:
  /// Throws std::bad_alloc if no address space is left for OpenBLAS's work buffer of this thread
  /// (128 MiB); OpenBLAS itself would retry forever, e.g. under a limit (ulimit -v). `has_buffer`:
  /// the caller has reserved it before.
  explicit OneBlasThread(bool has_buffer = false);
  ~OneBlasThread();
  OneBlasThread(const OneBlasThread&) = delete;
  OneBlasThread& operator=(const OneBlasThread&) = delete;

 private:
  int openmp_threads_ = 0;
};

}  // namespace revisit::engine
