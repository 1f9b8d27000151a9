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
                         " MB (PlanOptions::max_arena_bytes); choose smaller input shapes"));
}

void check_arena(const Plan::Impl& plan, int64_t limit) {
  constexpr auto kFloat = static_cast<int64_t>(sizeof(float));
  if (plan.arena_floats <= limit / kFloat) return;
  const auto largest =
      std::max_element(plan.buffers.begin(), plan.buffers.end(),
                       [](const BufferUse& a, const BufferUse& b) { return a.bytes < b.bytes; });
  throw InputError(str(plan.net->file, ": running the net takes ",
                       plan.arena_floats / (kMegabyte / kFloat), " MB, more than the limit of ",
                       limit / kMegabyte, " MB (PlanOptions::max_arena_bytes); most is for '",
                       largest->what, "': ", largest->bytes / kMegabyte,
                       " MB; choose smaller input shapes"));
}

void check_threads(int threads) {
  if (threads > kMostThreads)
    throw UsageError(str("expected at most ", kMostThreads, " threads, found ", threads));
}

}  // namespace revisit::engine
