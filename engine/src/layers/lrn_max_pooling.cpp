#include "layers/lrn_max_pooling.h"

#include "kernels/blocked/lrn.h"

namespace revisit::engine {
namespace {

class LrnMaxPooling : public Layer {
 public:
  LrnMaxPooling(const LrnProblem& lrn, const PoolingProblem& pooling)
      : lrn_(lrn), pooling_(pooling) {}

  std::vector<Shape> infer(const std::vector<Shape>&, size_t) const override {
    return {Shape{lrn_.n, lrn_.c, pooling_.out_h, pooling_.out_w}};
  }

  Kernel bind(const Binding& binding) const override {
    LrnProblem lrn = lrn_;
    PoolingProblem pooling = pooling_;
    lrn.threads = pooling.threads = binding.threads;
    return blocked_kernel(
        "lrn + max-pool", 1,
        [lrn, pooling](const Call& call) {
          blocked_lrn_max_pool(lrn, pooling, call.inputs[0], call.outputs[0], call.scratch);
        },
        blocked_lrn_max_pool_scratch_floats(lrn, pooling));
  }

 private:
  LrnProblem lrn_;
  PoolingProblem pooling_;
};

}  // namespace

std::unique_ptr<Layer> make_lrn_max_pooling(const LrnProblem& lrn, const PoolingProblem& pooling) {
  return std::make_unique<LrnMaxPooling>(lrn, pooling);
}

}  // namespace revisit::engine
