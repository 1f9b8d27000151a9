// What cutting a network off saves of a large weights file.
#include <fcntl.h>
#include <gtest/gtest.h>
#include <spawn.h>
#include <sys/resource.h>
#include <sys/wait.h>

#include <chrono>
#include <set>

#include "revisit/engine/net.h"
#include "revisit/proto/weights_file.h"
#include "sparse_model.h"
#include "test_data.h"

extern char** environ;

namespace revisit {
namespace {

namespace fs = std::filesystem;

/// Runs `revisit` without a shell and returns its peak resident memory [bytes], 0 when it fails.
int64_t peak_memory(std::vector<std::string> arguments) {
  arguments.insert(arguments.begin(), REVISIT_PROGRAM);
  std::vector<char*> argv;
  for (std::string& argument : arguments) argv.push_back(argument.data());
  argv.push_back(nullptr);
  posix_spawn_file_actions_t files;
  posix_spawn_file_actions_init(&files);
  posix_spawn_file_actions_addopen(&files, 1, "/dev/null", O_WRONLY, 0);
  pid_t child = -1;
  EXPECT_EQ(posix_spawn(&child, REVISIT_PROGRAM, &files, nullptr, argv.data(), environ), 0);
  posix_spawn_file_actions_destroy(&files);
  int status = -1;
  rusage usage{};
  EXPECT_EQ(wait4(child, &status, 0, &usage), child);
  EXPECT_EQ(status, 0);
  return int64_t{usage.ru_maxrss} << 10;
}

class LargeWeights : public testing::Test {
 protected:
  LargeWeights() { test::write_sparse_alexnet(weights_); }
  const test::TempDir dir_;
  const fs::path weights_ = dir_ / "alexnet.caffemodel";
};

TEST_F(LargeWeights, LayersBeyondTheEndAreNotRead) {
  EXPECT_EQ(fs::file_size(weights_) / 1'000'000, 243U);
  const auto start = std::chrono::steady_clock::now();
  const auto file = proto::WeightsFile::open(weights_);
  EXPECT_LT(file->bytes_read(), 100'000U);
  for (size_t i = 0; i < file->layers().size(); ++i)
    if (std::set<std::string>{"conv1", "conv2", "conv3", "conv4"}.contains(file->layers()[i].name))
      file->read(i);
  const std::chrono::duration<double> time = std::chrono::steady_clock::now() - start;
  RecordProperty("read_percent", std::to_string(100.0 * static_cast<double>(file->bytes_read()) /
                                                static_cast<double>(fs::file_size(weights_))));
  RecordProperty("seconds", std::to_string(time.count()));
  EXPECT_LT(file->bytes_read(), fs::file_size(weights_) / 25);
  EXPECT_LT(time.count(), 2);
}

TEST_F(LargeWeights, InspectingTheBeginningTakesItsMemoryOnly) {
#ifdef __SANITIZE_ADDRESS__
  GTEST_SKIP() << "what is resident here is the sanitizer's shadow and freed memory for the most";
#endif
  REVISIT_NEED_SHARED(prototxt, "data/nets/bvlc_alexnet_deploy.prototxt");
  const engine::Net net = engine::Net::load(prototxt, weights_, {.truncation = {"conv4", ""}});
  EXPECT_LT(net.weight_bytes_read(), fs::file_size(weights_) / 25);
  const engine::Plan plan = net.plan();
  // What the program takes for a net without weights to speak of.
  test::write_file(dir_ / "tiny.prototxt",
                   "input: 'x' input_shape { dim: 1 }"
                   "layer { name: 'r' type: 'ReLU' bottom: 'x' top: 'y' }");
  const int64_t overhead = peak_memory({"net", "inspect", (dir_ / "tiny.prototxt").string()});
  const int64_t peak =
      peak_memory({"net", "inspect", prototxt.string(), weights_.string(), "--end", "conv4"});
  RecordProperty("overhead_mb", std::to_string(overhead >> 20));
  RecordProperty("peak_mb", std::to_string(peak >> 20));
  EXPECT_LT(peak, overhead + 2 * plan.weight_bytes() + plan.arena_bytes());
}

}  // namespace
}  // namespace revisit
