#include <algorithm>

#include "plan_impl.h"

namespace revisit::engine {
namespace {

// Far above any use, because OpenMP terminates the program if it cannot create a thread.
constexpr int kMaxThreads = 1024;

int64_t bytes_of(const Shape& shape) {
  return floats(shape.elements()).count;
}

}  // namespace

void check_weight_bytes(const Net::Impl& net, int64_t limit) {
  int64_t bytes = 0;
  for (const Node& node : net.graph.nodes) {
    for (const Tensor& weight : *node.weights) bytes += bytes_of(weight.shape);
    if (bytes <= limit) continue;
    throw InputError(net.file, ": layer '", node.name, "' (", node.param.type(),
                     "): the weights up to here take ", bytes / kMegabyte,
                     " MB, more than the limit of ", limit / kMegabyte,
                     " MB (raise the limit of weights); check its num_output and kernel size");
  }
}

void check_outputs(const std::vector<Shape>& outputs, int64_t limit) {
  int64_t bytes = 0;
  for (const Shape& output : outputs) bytes += bytes_of(output);
  if (bytes > limit)
    throw InputError("its outputs take ", bytes / kMegabyte, " MB, more than the limit of ",
                     limit / kMegabyte, " MB (raise the limit of a run); choose smaller input shapes");
}

void check_run_memory(const Plan::Impl& plan, int64_t limit) {
  const Schedule& schedule = plan.schedule;
  if (schedule.arena_bytes + schedule.packed_bytes <= limit) return;
  const auto largest =
      std::max_element(schedule.buffers.begin(), schedule.buffers.end(),
                       [](const BufferUse& a, const BufferUse& b) { return a.bytes < b.bytes; });
  throw InputError(plan.net->file, ": running the net takes ", schedule.arena_bytes / kMegabyte,
                   " MB for values and ", schedule.packed_bytes / kMegabyte,
                   " MB for packed weights, in addition to ", plan.weight_bytes / kMegabyte,
                   " MB of weights, more than the limit of ", limit / kMegabyte,
                   " MB (raise the limit of a run); the largest buffer is of '", largest->what,
                   "': ", largest->bytes / kMegabyte,
                   " MB; choose smaller input shapes or fewer threads");
}

void check_threads(int threads) {
  if (threads < 1) throw UsageError("expected at least 1 thread, found ", threads);
  if (threads > kMaxThreads)
    throw UsageError("expected at most ", kMaxThreads, " threads, found ", threads);
}

}  // namespace revisit::engine
