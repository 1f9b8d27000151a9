#include "fuse.h"

#include "kernels/blocked/kernels.h"
#include "kernels/blocked/partition.h"
#include "layers/convolution.h"

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
    const Form& form = operation.form;
    if (const auto* affine = std::get_if<ChannelAffine>(&form)) return take(operation, *affine);
    if (const auto* activation = std::get_if<Activating>(&form))
      return take(operation, *activation);
    if (const auto* combining = std::get_if<Combining>(&form)) return take(operation, *combining);
    if (const auto* pooling = std::get_if<PoolingProblem>(&form)) return take(operation, *pooling);
    return false;
  }

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

}  // namespace

Operations fuse(Operations operations, bool may_pack) {
  return Fuser(std::move(operations)).run(may_pack);
}

}  // namespace revisit::engine
