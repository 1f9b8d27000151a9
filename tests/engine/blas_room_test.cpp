// The engine under an address space limit, where OpenBLAS would retry allocations forever.
#include <sys/resource.h>

#include <new>

#include "kernels/nchw.h"
#include "net_case.h"
#include "revisit/engine/machine.h"
#include "revisit/engine/net.h"
#include "testing.h"

namespace revisit::engine {
namespace {

/// More threads than any earlier test can have multiplied with.
constexpr int kManyThreads = 64;

void limit_memory() {
  std::ifstream sizes("/proc/self/statm");
  rlim_t pages = 0;
  sizes >> pages;
  const rlim_t bytes = pages * 4096 + (rlim_t{256} << 20);
  const rlimit limit{bytes, bytes};
  setrlimit(RLIMIT_AS, &limit);
}

/// Exits with 7 when `work` throws std::bad_alloc, 8 for MemoryError.
template <class Work>
void expect_no_memory(const Work& work) {
  limit_memory();
  try {
    work();
  } catch (const std::bad_alloc&) {
    std::_Exit(7);
  } catch (const MemoryError&) {
    std::_Exit(8);
  }
  std::_Exit(0);
}

TEST(BlasRoomTooLargeDeathTest, NoneIsOutOfMemory) {
  EXPECT_EXIT(expect_no_memory([] { const BlasWorkspace room(kManyThreads); }),
              testing::ExitedWithCode(7), "");
  EXPECT_EXIT(expect_no_memory([] { const BlasWorkspace room(1); }), testing::ExitedWithCode(0),
              "");
}

class BlasRoomDeathTest : public testing::TestWithParam<const char*> {};

/// Kernels declare manually whether they call OpenBLAS (Work::uses_blas).
TEST_P(BlasRoomDeathTest, ARunThatMultipliesByOpenBlasAsksForIt) {
  const TempDir dir;
  write_file(dir / "net.prototxt",
             str("input: 'data' input_shape { dim: 64 dim: 8 dim: 2 dim: 2 dim: 2 }\n",
                 "layer { name: 'a' bottom: 'data' top: 'a' ", GetParam(), " }"));
  const Net net = Net::load_with_random_weights(dir / "net.prototxt", 1);
  PlanOptions options;
  options.threads = kManyThreads;
  const Plan plan = net.plan({}, options);
  EXPECT_EXIT(expect_no_memory([&] { const engine::Run run(plan); }), testing::ExitedWithCode(8),
              "");
  options.reference_kernels = true;
  const Plan reference = net.plan({}, options);
  EXPECT_EXIT(expect_no_memory([&] { const engine::Run run(reference); }),
              testing::ExitedWithCode(0), "");
}

INSTANTIATE_TEST_SUITE_P(
    Kernels, BlasRoomDeathTest,
    testing::Values("type: 'InnerProduct' inner_product_param { num_output: 16 }",
                    "type: 'Convolution' convolution_param { num_output: 4 kernel_size: 1 }",
                    "type: 'Convolution' convolution_param { num_output: 4 kernel_size: 3 pad: 1 }",
                    "type: 'Deconvolution' convolution_param { num_output: 4 kernel_size: 2 }"));

TEST(PackedWeightsDeathTest, APlanAsksForTheirMemory) {
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
  GTEST_SKIP() << "a sanitizer ends a program that is out of memory";
#endif
  const Net net = test::small_net(
      {1, 2048, 24, 24}, test::conv("c", "data", "num_output: 1024 kernel_size: 3 pad: 1"));
  constexpr int64_t kAll = int64_t{256} << 20;
  ASSERT_GT(net.plan().packed_weight_bytes(), kAll);
  EXPECT_EXIT(expect_no_memory([&] { net.plan(); }), testing::ExitedWithCode(8), "");
  EXPECT_EXIT(expect_no_memory([&] { net.plan({}, {.max_run_bytes = kAll / 4}); }),
              testing::ExitedWithCode(0), "");
}

}  // namespace
}  // namespace revisit::engine
