#include <algorithm>
#include <cstring>
#include <limits>
#include <memory>
#include <new>

#include "aligned.h"
#include "kernels/float_mode.h"
#include "plan_impl.h"

namespace revisit::engine {
namespace {

constexpr float kNan = std::numeric_limits<float>::quiet_NaN();

float* floats_at(std::byte* memory) {
  return reinterpret_cast<float*>(memory);
}

template <class Slots>
const Plan::Impl::Slot& find_slot(const Slots& slots, std::string_view name, const char* what) {
  const auto found = slots.find(name);
  if (found != slots.end()) return found->second;
  std::vector<std::string> known;
  for (const auto& [slot, place] : slots) known.push_back(slot);
  throw UsageError("this run keeps no ", what, " '", name, "'", nearest_name_hint(name, known));
}

FloatMode mode_of(const Plan::Impl& plan) {
  const FloatMode mode = FloatMode::current();
  return plan.flush_denormals ? mode.flushing_denormals() : mode;
}

}  // namespace

struct Run::Memory {
  std::unique_ptr<BlasWorkspace> blas_workspace;
  AlignedFloats floats;
  std::byte* arena = nullptr;  // memory of `floats`
  struct Operands {
    std::vector<const float*> inputs;
    std::vector<float*> outputs;
    float* scratch;
    float* state;
  };
  std::vector<Operands> operands;  // as plan.steps
  std::vector<int64_t> rows;  // as plan.costs: last numbers of rows of layers with dynamic rows

  View<const float> view(const Plan::Impl::Slot& slot) const {
    Shape shape = slot.shape;
    if (slot.rows)
      shape = shape.with_rows(slot.rows->axis, slot.rows->multiple * rows[slot.rows->layer]);
    return {floats_at(arena + slot.offset), std::move(shape)};
  }

  void run(const Step& step, size_t i) {
    const Operands& o = operands[i];
    step.kernel.run(
        {o.inputs, o.outputs, o.scratch, o.state, &rows[step.layer], step.weights.get()});
  }
};

// Moving a plan copies it, which is cheap.
Run::Run(Plan plan) : plan_(std::move(plan)) {  // NOLINT(performance-*)
  const Plan::Impl& impl = *plan_.impl_;
  if (!impl.net->has_weights)
    throw UsageError(impl.net->file + ": the net was loaded without weights; give a caffemodel");
  try {
    memory_ = std::make_unique<Memory>();
    memory_->rows.assign(impl.costs.size(), 0);
    memory_->floats = AlignedFloats(plan_.arena_bytes() / static_cast<int64_t>(sizeof(float)));
    if (impl.blas_threads > 0)
      memory_->blas_workspace = std::make_unique<BlasWorkspace>(impl.blas_threads);
  } catch (const std::bad_alloc&) {
    throw MemoryError(impl.net->file, ": out of memory for a run: ", plan_.arena_bytes() >> 20,
                      " MB of values and ", 128 * impl.blas_threads,
                      " MB of OpenBLAS's buffers; choose smaller input shapes, fewer threads "
                      "or fewer runs at a time");
  }
  std::byte* const arena = memory_->arena = reinterpret_cast<std::byte*>(memory_->floats.data());
  // Kernels touch pages first, which places them near their threads.
#ifdef REVISIT_POISON  // reads of uninitialized memory then yield NaN in every type
  std::memset(arena, 0xFF, static_cast<size_t>(plan_.arena_bytes()));
#endif
  for (const auto& [blob, slot] : impl.input_slots)
    std::fill_n(floats_at(arena + slot.offset), slot.shape.elements(), kNan);
  const std::vector<Stored>& stored = impl.schedule.stored;
  for (const Step& step : impl.schedule.steps) {
    std::fill_n(arena + step.state, step.kernel.state.count, std::byte{});
    Memory::Operands operands{
        {}, {}, floats_at(arena + step.scratch), floats_at(arena + step.state)};
    for (const size_t id : step.inputs)
      operands.inputs.push_back(floats_at(arena + stored[id].offset));
    for (const size_t id : step.outputs)
      operands.outputs.push_back(floats_at(arena + stored[id].offset));
    memory_->operands.push_back(std::move(operands));
  }
}

Run::Run(Run&&) noexcept = default;
Run& Run::operator=(Run&&) noexcept = default;
Run::~Run() = default;

Run::Memory& Run::memory() const {
  if (!memory_) throw UsageError("this run was moved from; use the run that it was moved to");
  return *memory_;
}

View<float> Run::input(std::string_view blob) {
  Memory& memory = this->memory();
  const Plan::Impl::Slot& slot = find_slot(plan_.impl_->input_slots, blob, "input");
  return {floats_at(memory.arena + slot.offset), slot.shape};
}

View<const float> Run::output(std::string_view name) const {
  return memory().view(find_slot(plan_.impl_->output_slots, name, "output"));
}

View<const float> Run::layer_output(std::string_view name) const {
  return memory().view(find_slot(plan_.impl_->layer_slots, name, "output of a layer"));
}

void Run::forward() noexcept {
  Memory& memory = this->memory();
  const FloatModeScope scope(mode_of(*plan_.impl_));
  const std::vector<Step>& steps = plan_.impl_->schedule.steps;
  for (size_t i = 0; i < steps.size(); ++i) memory.run(steps[i], i);
}

void Run::forward(const std::function<void(size_t, bool)>& observe) {
  Memory& memory = this->memory();
  const std::vector<Step>& steps = plan_.impl_->schedule.steps;
  for (size_t i = 0; i < steps.size(); ++i) {
    observe(steps[i].layer, false);
    {
      const FloatModeScope scope(mode_of(*plan_.impl_));
      memory.run(steps[i], i);
    }
    observe(steps[i].layer, true);
  }
}

}  // namespace revisit::engine
