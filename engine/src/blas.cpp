#include <cblas.h>
#include <omp.h>
#include <sys/mman.h>

#include <algorithm>
#include <array>
#include <new>
#include <vector>

#include "kernels/nchw.h"
#include "process_lock.h"
#include "revisit/engine/machine.h"

namespace revisit::engine {
namespace {

#ifdef __x86_64__
enum class Vectors { kOlder, kAvx2, kAvx512 };

Vectors vectors_of(const std::string& core) {
  constexpr std::array kAvx512 = {"SkylakeX", "Cooperlake", "SapphireRapids"};
  constexpr std::array kAvx2 = {"Haswell", "Zen", "Excavator"};
  if (std::find(kAvx512.begin(), kAvx512.end(), core) != kAvx512.end()) return Vectors::kAvx512;
  if (std::find(kAvx2.begin(), kAvx2.end(), core) != kAvx2.end()) return Vectors::kAvx2;
  return Vectors::kOlder;
}
#endif

bool blas_is_on_openmp() {
  static const bool kIs = openblas_get_parallel() == OPENBLAS_OPENMP;
  return kIs;
}

/// Guarded by process_lock().
struct Held {
  int now = 0, most = 0;
} blas_buffers;

/// Maps one by one, like OpenBLAS.
bool can_be_mapped(int count) {
  constexpr size_t kBytes = (size_t{128} << 20) + 4096;  // maximum size of an OpenBLAS buffer
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

std::string blas_core() {
  return openblas_get_corename();
}

std::string faster_blas_core() {
#ifdef __x86_64__
  const Vectors used = vectors_of(blas_core());
  const bool avx512 = __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512bw") &&
                      __builtin_cpu_supports("avx512dq") && __builtin_cpu_supports("avx512vl");
  if (avx512 && used < Vectors::kAvx512) return "SkylakeX";
  if (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma") && used < Vectors::kAvx2)
    return "Haswell";
#endif
  return "";
}

OneBlasThread::OneBlasThread(bool has_buffer) {
  if (!has_buffer) {
    thread_local const BlasWorkspace buffer(1);
  }
  if (blas_is_on_openmp()) {
    openmp_threads_ = omp_get_max_threads();
    omp_set_num_threads(1);
    return;
  }
  static const bool kSet = [] {
    openblas_set_num_threads(1);
    return true;
  }();
  static_cast<void>(kSet);
}

OneBlasThread::~OneBlasThread() {
  if (blas_is_on_openmp()) omp_set_num_threads(openmp_threads_);
}

BlasWorkspace::BlasWorkspace(int threads) : threads_(threads) {
  const std::scoped_lock lock(process_lock());
  // OpenBLAS never frees its buffers, so the previous maximum is available. A larger count is
  // tested completely, because it is unknown which buffers are mapped already.
  if (blas_buffers.now + threads > blas_buffers.most && !can_be_mapped(blas_buffers.now + threads))
    throw std::bad_alloc();
  blas_buffers.now += threads;
  blas_buffers.most = std::max(blas_buffers.most, blas_buffers.now);
}

BlasWorkspace::~BlasWorkspace() {
  const std::scoped_lock lock(process_lock());
  blas_buffers.now -= threads_;
}

void gemm(const GemmProblem& p) {
  const OneBlasThread one_thread(
      true);  // callers split the work, independent of the number of threads
  const auto narrow = [](int64_t value) { return static_cast<blasint>(value); };
  cblas_sgemm(CblasRowMajor, p.transpose_a ? CblasTrans : CblasNoTrans,
              p.transpose_b ? CblasTrans : CblasNoTrans, narrow(p.m), narrow(p.n), narrow(p.k),
              1.0F, p.a, narrow(p.lda), p.b, narrow(p.ldb), 0.0F, p.c, narrow(p.ldc));
}

}  // namespace revisit::engine
