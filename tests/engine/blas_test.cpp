#include <omp.h>

#include "kernels/nchw.h"
#include "revisit/engine/machine.h"
#include "testing.h"

namespace revisit::engine {
namespace {

int64_t threads_of_process() {
  return std::distance(std::filesystem::directory_iterator("/proc/self/task"), {});
}

std::vector<float> large_product() {
  constexpr int64_t kSize = 600;
  std::vector<float> a(kSize * kSize), b(a.size()), c(a.size());
  for (size_t i = 0; i < a.size(); ++i) {
    a[i] = static_cast<float>(i * 7919 % 101) / 101 - 0.5F;
    b[i] = static_cast<float>(i * 104729 % 103) / 103 - 0.5F;
  }
  gemm({kSize, kSize, kSize, a.data(), kSize, b.data(), kSize, false, c.data(), kSize});
  return c;
}

/// OpenBLAS with OpenMP starts a team for each calling thread unless limited. Run with
/// LD_LIBRARY_PATH on libopenblas0-openmp to test it.
TEST(OneBlasThread, AProductOnANewThreadStartsNoOther) {
  const std::vector<float> here = large_product();
  std::vector<float> there;
  int64_t started = -1;
  int openmp_threads_before = -1, openmp_threads_after = -2;
  std::thread([&] {
    omp_set_num_threads(3);
    openmp_threads_before = omp_get_max_threads();
    const int64_t before = threads_of_process();
    there = large_product();
    started = threads_of_process() - before;
    openmp_threads_after = omp_get_max_threads();
  }).join();
  EXPECT_EQ(started, 0);
  EXPECT_EQ(openmp_threads_after, openmp_threads_before);
  EXPECT_EQ(there, here);
}

}  // namespace
}  // namespace revisit::engine
