#include <algorithm>
#include <numeric>

#include "kernels/blocked/kernels.h"
#include "kernels/blocked/partition.h"
#include "layers/convolution.h"
#include "schedule.h"

namespace revisit::engine {
namespace {

class Fuser {
 public:
  explicit Fuser(Operations operations)
      : operations_(std::move(operations)),
        readers_(operations_.held_by.size(), 0),
        maker_(operations_.held_by.size(), kNone) {
    for (const Operation& operation : operations_.list)
      for (const ValueId id : operation.inputs) ++readers_[id];
    for (size_t id = 0; id < readers_.size(); ++id) readers_[id] += operations_.read_outside[id];
  }

  Operations run(bool may_pack) {
    rewrite([this](const Operation& operation) { return merge(operation); });
    if (may_pack)
      rewrite([this](const Operation& operation) { return merge_into_first(operation); });
    return std::move(operations_);
  }

 private:
  static constexpr size_t kNone = SIZE_MAX;

  template <class Merged>
  void rewrite(const Merged& merged) {
    std::vector<Operation> old;
    std::swap(old, operations_.list);
    for (Operation& operation : old) {
      if (merged(operation)) continue;
      for (const ValueId id : operation.outputs) maker_[id] = operations_.list.size();
      operations_.list.push_back(std::move(operation));
    }
  }

  bool merge(const Operation& operation) {
    return std::visit([&](const auto& form) { return take(operation, form); }, operation.form);
  }

  /// Merges the operation into the maker of its input, if it is of a form that allows this.
  bool take(const Operation& /*operation*/, const auto& /*form*/) { return false; }

  Operation* only_maker(ValueId id) {
    if (readers_[id] != 1 || maker_[id] == kNone) return nullptr;
    Operation& maker = operations_.list[maker_[id]];
    return maker.outputs.size() == 1 ? &maker : nullptr;
  }

  static bool is_activated(const Operation& operation) {
    return operation.fusion.activation.epilogue.activation != Epilogue::Activation::kNone;
  }

  void absorb(Operation* into, const Operation& operation) {
    into->absorbed.push_back(operation.node);
    into->absorbed.insert(into->absorbed.end(), operation.absorbed.begin(),
                          operation.absorbed.end());
    into->outputs = operation.outputs;
    maker_[operation.outputs[0]] = static_cast<size_t>(into - operations_.list.data());
  }

  bool take(const Operation& operation, const ChannelAffine& next) {
    Operation* const maker = only_maker(operation.inputs[0]);
    if (!maker || is_activated(*maker) || maker->fusion.adds_last_input) return false;
    const Form& form = maker->form;
    if (!std::holds_alternative<Convolving>(form) && !std::holds_alternative<ChannelAffine>(form))
      return false;
    std::optional<ChannelAffine>& affine = maker->fusion.affine;
    affine = affine ? composed(*affine, next) : next;
    maker->fusion.affine_layers.push_back(operation.node);
    absorb(maker, operation);
    return true;
  }

  bool take(const Operation& operation, const Activating& activation) {
    Operation* const maker = only_maker(operation.inputs[0]);
    if (!maker || is_activated(*maker)) return false;
    const Form& form = maker->form;
    if (!std::holds_alternative<Convolving>(form) && !std::holds_alternative<ChannelAffine>(form) &&
        !std::holds_alternative<Combining>(form) && !std::holds_alternative<Gating>(form))
      return false;
    maker->fusion.activation = activation;
    absorb(maker, operation);
    return true;
  }

  /// The later producer of the two inputs adds the other input, which is available by then.
  bool take(const Operation& operation, const Combining& combining) {
    if (combining.operation != BlockedEltwise::Operation::kSum ||
        combining.coefficients != std::vector<float>{1, 1})
      return false;
    const auto made_at = [&](ValueId id) {
      return maker_[id] == kNone ? 0 : maker_[id] + 1;  // inputs of the net come first
    };
    ValueId sums = operation.inputs[0], addend = operation.inputs[1];
    if (made_at(sums) < made_at(addend)) std::swap(sums, addend);
    Operation* const maker = only_maker(sums);
    if (!maker || is_activated(*maker) || maker->fusion.adds_last_input || !can_add(*maker, addend))
      return false;
    maker->fusion.adds_last_input = true;
    maker->inputs.push_back(addend);
    absorb(maker, operation);
    return true;
  }

  /// An in-place NCHW gate overwrites its input before the addition, so the addend must differ.
  static bool can_add(const Operation& maker, ValueId addend) {
    const auto* gating = std::get_if<Gating>(&maker.form);
    return std::holds_alternative<Convolving>(maker.form) ||
           (gating && !gating->addend && maker.inputs[gating->x] != addend);
  }

  bool take(const Operation& operation, const PoolingProblem& pooling) {
    Operation* const maker = only_maker(operation.inputs[0]);
    const auto* lrn = maker ? std::get_if<LrnProblem>(&maker->form) : nullptr;
    if (!lrn || operation.outputs.size() != 1 || maker->fusion.pooling || !has_blocked_kernels() ||
        !fills_blocks(lrn->c) || !is_worth_pooling_in_pieces(pooling, lrn->c))
      return false;
    maker->fusion.pooling = pooling;
    absorb(maker, operation);
    return true;
  }

  /// Fuses pooling, with or without LRN, and fixes a kernel that supports it.
  bool merge_into_first(const Operation& operation) {
    if (operation.outputs.size() != 1) return false;
    const auto* lrn = std::get_if<LrnProblem>(&operation.form);
    const auto* alone = std::get_if<PoolingProblem>(&operation.form);
    if (!alone && !operation.fusion.pooling) return false;
    Operation* const first = only_maker(operation.inputs[0]);
    const auto* convolving = first ? std::get_if<Convolving>(&first->form) : nullptr;
    if (!convolving || maker_[first->inputs[0]] != kNone || first->fusion.adds_last_input ||
        first->fusion.pooling)
      return false;
    Fusion fusion = first->fusion;
    fusion.pooling = alone ? *alone : operation.fusion.pooling;
    if (!is_worth_pooling_in_pieces(*fusion.pooling, convolving->problem.c_out)) return false;
    if (lrn) fusion.lrn = *lrn;
    const BlockedConvolutionKernel* const kernel =
        choose_convolution(convolving->problem, fusion, Layout::kNchw, first->max_winograd_points);
    if (!kernel) return false;
    first->convolution = kernel;
    first->fusion = std::move(fusion);
    absorb(first, operation);
    return true;
  }

  Operations operations_;
  std::vector<int> readers_;
  std::vector<size_t> maker_;  // per value: index into operations_.list; kNone: a net input
};

bool changes_nothing(const Node& node, const std::vector<Shape>& shapes) {
  return node.layer->output_memory() == OutputMemory::kViewOfInput &&
         std::all_of(node.outputs.begin(), node.outputs.end(),
                     [&](ValueId id) { return shapes[id] == shapes[node.inputs[0]]; });
}

bool supports_single_channel(const Operation& operation) {
  const auto* convolving = std::get_if<Convolving>(&operation.form);
  return convolving && convolving->problem.group == 1 && operation.inputs.size() == 1;
}

std::string single_channel_obstacle(const Net::Impl& net, const Operations& operations, ValueId id,
                                    const Shape& shape) {
  if (shape.rank() != 4) return str("the input must be n x c x h x w, found ", shape);
  for (const auto& [name, value] : net.graph.outputs)
    if (operations.held_by[value] == id) return str("the output '", name, "' is the input itself");
  for (const Operation& operation : operations.list) {
    if (std::count(operation.inputs.begin(), operation.inputs.end(), id) == 0 ||
        supports_single_channel(operation))
      continue;
    const Node& node = net.graph.nodes[operation.node];
    return str("layer '", node.name, "' (", node.param.type(),
               ") reads the input; only convolutions without groups support a single channel");
  }
  return "";
}

ValueId only_input(const Net::Impl& net) {
  return std::ranges::find_if(net.graph.nodes, [](const Node& node) { return !node.layer; })
      ->outputs[0];
}

}  // namespace

Operations fuse(Operations operations, bool may_pack) {
  return Fuser(std::move(operations)).run(may_pack);
}

Operations operations_of(const Net::Impl& net, const std::vector<Shape>& shapes,
                         const std::vector<ValueId>& kept) {
  Operations operations;
  std::vector<ValueId>& held_by = operations.held_by;
  held_by.resize(net.graph.values.size());
  std::iota(held_by.begin(), held_by.end(), 0);
  for (size_t i = 0; i < net.graph.nodes.size(); ++i) {
    const Node& node = net.graph.nodes[i];
    if (!node.layer) continue;
    if (changes_nothing(node, shapes)) {
      for (const ValueId id : node.outputs) held_by[id] = held_by[node.inputs[0]];
      continue;
    }
    Operation operation{
        i,           {},
        *node.layer, node.layer->form(shapes_of(node.inputs, shapes), *node.weights),
        node.inputs, node.outputs};
    if (operation.layer.get().output_memory() == OutputMemory::kViewOfInput)
      operation.inputs.resize(1);  // further inputs only define the shape
    for (ValueId& id : operation.inputs) id = held_by[id];
    operations.list.push_back(std::move(operation));
  }
  operations.read_outside.resize(held_by.size(), false);
  for (const ValueId id : kept) operations.read_outside[held_by[id]] = true;
  for (const auto& [name, value] : net.graph.outputs)
    operations.read_outside[held_by[value]] = true;
  return operations;
}

void fold_single_channel_input(const Net::Impl& net, const std::vector<Shape>& shapes,
                               const std::vector<float>& offsets, Operations* operations) {
  if (net.inputs.size() != 1)
    throw UsageError("single-channel input: expected a net with one input, found ",
                     net.inputs.size());
  const ValueId id = only_input(net);
  const Shape& shape = shapes[id];
  const std::string reason = single_channel_obstacle(net, *operations, id, shape);
  if (!reason.empty()) throw UsageError("single-channel input: " + reason);
  if (shape[1] != static_cast<int64_t>(offsets.size()))
    throw UsageError("single-channel input: expected an offset for each of the ", shape[1],
                     " channels of the input, found ", offsets.size());
  for (Operation& operation : operations->list)
    if (std::count(operation.inputs.begin(), operation.inputs.end(), id) > 0)
      operation.fusion.channel_offsets = offsets;
  operations->gray_input = id;
}

bool Net::takes_single_channel_input() const {
  if (impl_->inputs.size() != 1) return false;
  const std::vector<Shape> shapes =
      infer_shapes(*impl_, {{impl_->inputs[0].name, impl_->inputs[0].shape}});
  const ValueId id = only_input(*impl_);
  return single_channel_obstacle(*impl_, operations_of(*impl_, shapes), id, shapes[id]).empty();
}

// docs/reference/ACCURACY.md has the rule, and errors of nets with and without it.
std::vector<bool> sensitive_values(const Graph& graph) {
  struct Later {
    bool amplified = false, compared = false;
  };
  std::vector<Later> later(graph.values.size());
  for (auto node = graph.nodes.rbegin(); node != graph.nodes.rend(); ++node) {
    if (!node->layer) continue;
    Later of_outputs;
    for (const ValueId id : node->outputs) {
      of_outputs.amplified |= later[id].amplified;
      of_outputs.compared |= later[id].compared;
    }
    const Rounding rounding = node->layer->rounding();
    const bool is_view = node->layer->output_memory() == OutputMemory::kViewOfInput;
    for (const ValueId id : node->inputs) {
      if (is_view && id != node->inputs[0]) continue;  // further inputs only define the shape
      later[id].amplified |= of_outputs.amplified || rounding == Rounding::kAmplified;
      later[id].compared |= (of_outputs.compared && rounding != Rounding::kAveraged) ||
                            rounding == Rounding::kCompared;
    }
  }
  std::vector<bool> sensitive;
  for (const Later& value : later) sensitive.push_back(value.amplified || value.compared);
  return sensitive;
}

void limit_rounding(bool strict, const std::vector<bool>& sensitive, Operations* operations) {
  constexpr int kLittleRounding = 6;
  for (Operation& operation : operations->list)
    if (strict || std::ranges::any_of(operation.outputs, [&](ValueId id) { return sensitive[id]; }))
      operation.max_winograd_points = kLittleRounding;
}

}  // namespace revisit::engine
