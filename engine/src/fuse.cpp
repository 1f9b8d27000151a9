#include "fuse.h"

#include <algorithm>

#include "layers/lrn_max_pooling.h"

namespace revisit::engine {
namespace {

/// Goes through the operations in order and merges each into the one that makes its input, where
/// that gives the same.
class Fuser {
 public:
  Fuser(const Net::Impl& net, const std::vector<Shape>& shapes)
      : net_(net), shapes_(shapes), readers_(shapes.size(), 0), maker_(shapes.size(), kNone) {}

  Operations run() {
    const Operations all = operations_of(net_);
    result_.held_by = all.held_by;
    for (const Operation& operation : all.list) forget_identities(operation);
    for (const Operation& operation : all.list)
      if (!is_identity(operation))
        for (const ValueId id : operation.inputs) ++readers_[held(id)];
    for (const Graph::Output& output : net_.graph.outputs) ++readers_[held(output.value)];

    for (Operation operation : all.list) {
      if (is_identity(operation)) continue;
      for (ValueId& id : operation.inputs) id = held(id);
      if (merge(operation)) continue;
      const size_t index = result_.list.size();
      for (const ValueId id : operation.outputs) maker_[id] = index;
      result_.list.push_back(std::move(operation));
    }
    return std::move(result_);
  }

 private:
  static constexpr size_t kNone = SIZE_MAX;

  ValueId held(ValueId id) const { return result_.held_by[id]; }

  bool is_identity(const Operation& operation) const {
    return operation.layer->output_memory() == OutputMemory::kViewOfInput &&
           std::all_of(operation.outputs.begin(), operation.outputs.end(),
                       [&](ValueId id) { return shapes_[id] == shapes_[operation.inputs[0]]; });
  }

  void forget_identities(const Operation& operation) {
    if (!is_identity(operation)) return;
    for (const ValueId id : operation.outputs) result_.held_by[id] = held(operation.inputs[0]);
  }

  Form form_of(const Operation& operation) const {
    std::vector<Shape> inputs;
    for (const ValueId id : operation.inputs) inputs.push_back(shapes_[id]);
    return operation.layer->form(inputs, net_.nodes[operation.node].weights);
  }

  bool merge(const Operation& operation) {
    const Form form = form_of(operation);
    if (const auto* affine = std::get_if<ChannelAffine>(&form)) return take(operation, *affine);
    if (const auto* activation = std::get_if<Activating>(&form))
      return take(operation, *activation);
    if (std::holds_alternative<Adding>(form)) return take_sum(operation);
    if (const auto* pooling = std::get_if<PoolingProblem>(&form))
      return take_pooling(operation, *pooling);
    return false;
  }

  /// The operation that makes a value which nothing but one reader needs; null when there is none.
  Operation* only_maker(ValueId id) {
    if (readers_[id] != 1 || maker_[id] == kNone) return nullptr;
    Operation& maker = result_.list[maker_[id]];
    return maker.outputs.size() == 1 ? &maker : nullptr;
  }

  /// The same, where it is a convolution whose sums are not yet put through an activation.
  Operation* only_convolution(ValueId id) {
    Operation* const maker = only_maker(id);
    const bool open = maker && std::holds_alternative<Convolving>(form_of_first(*maker)) &&
                      maker->fusion.activation.epilogue.activation == Epilogue::Activation::kNone;
    return open ? maker : nullptr;
  }

  /// An addend is no input of the layer itself.
  Form form_of_first(const Operation& operation) const {
    Operation first = operation;
    first.inputs.resize(net_.graph.nodes[operation.node].inputs.size());
    return form_of(first);
  }

  void absorb(Operation* into, const Operation& operation) {
    into->absorbed.push_back(operation.node);
    into->outputs = operation.outputs;
    maker_[operation.outputs[0]] = static_cast<size_t>(into - result_.list.data());
  }

  bool take(const Operation& operation, const ChannelAffine& next) {
    Operation* const convolution = only_convolution(operation.inputs[0]);
    if (!convolution || convolution->fusion.adds_last_input) return false;
    std::optional<ChannelAffine>& affine = convolution->fusion.affine;
    if (!affine) {
      affine = next;
    } else {
      for (size_t c = 0; c < next.scale.size(); ++c) {
        affine->scale[c] *= next.scale[c];
        affine->shift[c] = affine->shift[c] * next.scale[c] + next.shift[c];
      }
    }
    convolution->fusion.affine_layers.push_back(operation.node);
    absorb(convolution, operation);
    return true;
  }

  bool take(const Operation& operation, const Activating& activation) {
    Operation* const convolution = only_convolution(operation.inputs[0]);
    if (!convolution) return false;
    convolution->fusion.activation = activation;
    absorb(convolution, operation);
    return true;
  }

  /// Only the later of the two inputs' makers can add the other, which is there by then.
  bool take_sum(const Operation& operation) {
    const auto made_at = [&](ValueId id) {
      return maker_[id] == kNone ? 0 : maker_[id] + 1;  // inputs of the net: before all
    };
    ValueId sums = operation.inputs[0], addend = operation.inputs[1];
    if (made_at(sums) < made_at(addend)) std::swap(sums, addend);
    Operation* const convolution = only_convolution(sums);
    if (!convolution || convolution->fusion.adds_last_input) return false;
    convolution->fusion.adds_last_input = true;
    convolution->inputs.push_back(addend);
    absorb(convolution, operation);
    return true;
  }

  bool take_pooling(const Operation& operation, const PoolingProblem& pooling) {
    Operation* const maker = only_maker(operation.inputs[0]);
    if (!maker || operation.outputs.size() != 1) return false;
    const Form form = form_of_first(*maker);
    const auto* lrn = std::get_if<LrnProblem>(&form);
    if (!lrn) return false;
    maker->layer = make_lrn_max_pooling(*lrn, pooling);
    absorb(maker, operation);
    return true;
  }

  const Net::Impl& net_;
  const std::vector<Shape>& shapes_;
  Operations result_;
  std::vector<int> readers_;   // of each value
  std::vector<size_t> maker_;  // of each value: index into result_.list
};

}  // namespace

void fold_gray_input(const Net::Impl& net, const std::vector<Shape>& shapes,
                     const std::vector<float>& offsets, Operations* operations) {
  if (net.inputs.size() != 1)
    throw UsageError(str("gray: expected a net with one input, found ", net.inputs.size()));
  const auto input = std::find_if(net.nodes.begin(), net.nodes.end(),
                                  [](const LoadedNode& node) { return !node.layer; });
  const ValueId id = net.graph.nodes[input - net.nodes.begin()].outputs[0];
  const Shape& shape = shapes[id];
  if (shape.rank() != 4 || shape[1] != static_cast<int64_t>(offsets.size()))
    throw UsageError(str("gray: expected an offset for each channel of the input (", shape,
                         "), found ", offsets.size()));
  for (const Graph::Output& output : net.graph.outputs)
    if (operations->held_by[output.value] == id)
      throw UsageError(str("gray: the output '", output.name, "' is the input itself"));
  for (Operation& operation : operations->list) {
    for (size_t i = 0; i < operation.inputs.size(); ++i) {
      if (operation.inputs[i] != id) continue;
      const Form form = operation.layer->form({shape}, net.nodes[operation.node].weights);
      const auto* convolving = std::get_if<Convolving>(&form);
      if (i > 0 || !convolving || convolving->group != 1) {
        const Node& node = net.graph.nodes[operation.node];
        throw UsageError(str("gray: layer '", node.name, "' (", node.param.type(),
                             ") reads the input; only convolutions without groups can take one "
                             "channel for all"));
      }
      operation.fusion.gray_offsets = offsets;
    }
  }
  operations->gray_input = id;
}

Operations fuse(const Net::Impl& net, const std::vector<Shape>& shapes) {
  return Fuser(net, shapes).run();
}

}  // namespace revisit::engine
