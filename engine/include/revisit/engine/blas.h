#pragma once

#include <string>

namespace revisit::engine {

/// The set of kernels OpenBLAS uses, e.g. "SkylakeX". It is chosen when the library is loaded.
std::string blas_core();

/// A faster set that this CPU can run, when OpenBLAS uses a lesser one: it falls back to SSE3
/// kernels on CPUs newer than itself (up to ten times slower), and OPENBLAS_CORETYPE may hold it
/// back. Empty when there is none. To be set as OPENBLAS_CORETYPE before the program starts.
std::string faster_blas_core();

/// While one lives, OpenBLAS works on the calling thread alone: the result of a product depends on
/// how many threads share it. Every product of the engine is made under one.
///   - OpenBLAS with threads of its own (libopenblas0-pthread) has only one setting for the whole
///     process: the first OneBlasThread sets it to one thread and it stays so. A program that wants
///     more for products of its own calls openblas_set_num_threads() afterwards; the engine's
///     results are then the same to rounding only.
///   - OpenBLAS on OpenMP (libopenblas0-openmp) asks OpenMP how many threads the calling thread may
///     have: that is set to one, and set back in the end. Other threads see nothing of it.
class OneBlasThread {
 public:
  OneBlasThread();
  ~OneBlasThread();
  OneBlasThread(const OneBlasThread&) = delete;
  OneBlasThread& operator=(const OneBlasThread&) = delete;

 private:
  int openmp_threads_ = 0;  // before
};

/// Room for the work buffers of OpenBLAS [128 MiB a thread that multiplies at the same time]. Must
/// be held while multiplying: OpenBLAS retries for ever when it cannot get a buffer, so that under
/// a limit on the address space (ulimit -v) a program would hang instead of fail.
class BlasRoom {
 public:
  /// Throws std::bad_alloc without room for `threads` buffers beside those of all other holders.
  explicit BlasRoom(int threads);
  ~BlasRoom();
  BlasRoom(const BlasRoom&) = delete;
  BlasRoom& operator=(const BlasRoom&) = delete;

 private:
  int threads_;
};

}  // namespace revisit::engine
