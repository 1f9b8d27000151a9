#include "budget.h"

#include <algorithm>

namespace revisit::engine {
namespace {

constexpr int64_t kMegabyte = 1 << 20;
// Far beyond any use; where a thread cannot be made, OpenMP ends the program.
constexpr int kMostThreads = 1024;

int64_t bytes_of(const Shape& shape) {
  return shape.elements() * static_cast<int64_t>(sizeof(float));
}

}  // namespace

void check_weight_bytes(const Net::Impl& net, int64_t limit) {
  int64_t bytes = 0;
  for (size_t i = 0; i < net.nodes.size(); ++i) {
    for (const Tensor& weight : net.nodes[i].weights) bytes += bytes_of(weight.shape);
    if (bytes <= limit) continue;
    const Node& node = net.graph.nodes[i];
    throw InputError(
        str(net.file, ": layer '", node.name, "' (", node.param.type(),
            "): the weights up to here take ", bytes / kMegabyte, " MB, more than the limit of ",
            limit / kMegabyte,
            " MB (Limits::weight_bytes raises it); is its num_output or kernel right?"));
  }
}

void check_outputs(const std::vector<Shape>& outputs, int64_t limit) {
  int64_t bytes = 0;
  for (const Shape& output : outputs) bytes += bytes_of(output);
  if (bytes > limit)
    throw InputError(str("its outputs take ", bytes / kMegabyte, " MB, more than the limit of ",
                         limit / kMegabyte,
                         " MB (PlanOptions::max_run_bytes); choose smaller input shapes"));
}

void check_run_memory(const Net::Impl& net, const RunMemory& memory, int64_t limit) {
  constexpr auto kFloat = static_cast<int64_t>(sizeof(float));
  if (memory.arena_floats + memory.packed_floats <= limit / kFloat) return;
  const auto megabytes = [](int64_t floats) { return floats / (kMegabyte / kFloat); };
  const auto largest =
      std::max_element(memory.buffers.begin(), memory.buffers.end(),
                       [](const BufferUse& a, const BufferUse& b) { return a.bytes < b.bytes; });
  throw InputError(
      str(net.file, ": running the net takes ", megabytes(memory.arena_floats),
          " MB for values and ", megabytes(memory.packed_floats), " MB for packed weights, beside ",
          megabytes(memory.weight_floats), " MB of weights, more than the limit of ",
          limit / kMegabyte, " MB (PlanOptions::max_run_bytes); most is for '", largest->what,
          "': ", largest->bytes / kMegabyte, " MB; choose smaller input shapes or fewer threads"));
}

void check_threads(int threads) {
  if (threads < 1) throw UsageError(str("expected at least 1 thread, found ", threads));
  if (threads > kMostThreads)
    throw UsageError(str("expected at most ", kMostThreads, " threads, found ", threads));
}

}  // namespace revisit::engine
