#include <fcntl.h>
#include <spawn.h>
#include <sys/resource.h>
#include <sys/wait.h>

#include "revisit/engine/net.h"
#include "revisit/proto/weights_file.h"
#include "testing.h"
#include "wire_bytes.h"

extern char** environ;

namespace revisit {
namespace {

uint64_t product(const std::vector<uint64_t>& shape) {
  uint64_t count = 1;
  for (const uint64_t size : shape) count *= size;
  return count;
}

/// Shape, then the tag and length of the data.
std::string blob_start(const std::vector<uint64_t>& dims) {
  const uint64_t bytes = 4 * product(dims);
  const std::string start = test::shape(dims) + test::tag(5, 2) + test::varint(bytes);
  return test::tag(7, 2) + test::varint(start.size() + bytes) + start;
}

/// A caffemodel with AlexNet's layers and blob shapes: 61 million zeros, 244 MB, sparse on disk.
void write_sparse_alexnet(const fs::path& file) {
  struct Layer {
    const char* name;
    const char* type;
    std::vector<uint64_t> weights;
  };
  const Layer layers[] = {
      {"conv1", "Convolution", {96, 3, 11, 11}},  {"conv2", "Convolution", {256, 48, 5, 5}},
      {"conv3", "Convolution", {384, 256, 3, 3}}, {"conv4", "Convolution", {384, 192, 3, 3}},
      {"conv5", "Convolution", {256, 192, 3, 3}}, {"fc6", "InnerProduct", {4096, 9216}},
      {"fc7", "InnerProduct", {4096, 4096}},      {"fc8", "InnerProduct", {1000, 4096}}};
  std::ofstream out(file, std::ios::binary);
  const auto zeros = [&](uint64_t count) {
    out.seekp(static_cast<std::streamoff>(4 * count), std::ios::cur);
  };
  out << test::bytes_field(1, "AlexNet");
  for (const Layer& layer : layers) {
    const std::vector<uint64_t> bias = {layer.weights[0]};
    const std::string head = test::bytes_field(1, layer.name) + test::bytes_field(2, layer.type);
    const std::string weights = blob_start(layer.weights), biases = blob_start(bias);
    const uint64_t floats = product(layer.weights) + bias[0];
    out << test::tag(100, 2)
        << test::varint(head.size() + weights.size() + biases.size() + 4 * floats) << head
        << weights;
    zeros(product(layer.weights));
    out << biases;
    zeros(bias[0]);
  }
  const auto size = static_cast<uint64_t>(out.tellp());
  out.close();
  fs::resize_file(file, size);
  if (!out) ADD_FAILURE() << "cannot write " << file;
}

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
  LargeWeights() { write_sparse_alexnet(weights_); }
  const TempDir dir_;
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
  const engine::Net net = engine::Net::load(prototxt, weights_, {.end = "conv4"});
  EXPECT_LT(net.weight_bytes_read(), fs::file_size(weights_) / 25);
  const engine::Plan plan = net.plan();
  // Baseline: a net without weights.
  write_file(dir_ / "tiny.prototxt",
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
