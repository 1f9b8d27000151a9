#include "layers/lrn_max_pooling.h"

#include "kernels/blocked/lrn.h"

namespace revisit::engine {
namespace {

class LrnMaxPoolingLayer : public Layer {
 public:
  explicit LrnMaxPoolingLayer(const LrnMaxPooling& problem) : problem_(problem) {}

  std::vector<Shape> infer(const std::vector<Shape>&, size_t) const override {
    const PoolingProblem& p = problem_.pooling;
    return {Shape{problem_.lrn.n, problem_.lrn.c, p.out_h, p.out_w}};
  }

  Form form(const std::vector<Shape>&, const std::vector<Tensor>&) const override {
    return problem_;
  }

  Kernel bind(const Binding& binding) const override {
    LrnMaxPooling p = problem_;
    p.lrn.threads = p.pooling.threads = binding.threads;
    return blocked_kernel(
        "lrn + max-pool", 1,
        [p](const Call& call) {
          blocked_lrn_max_pool(p.lrn, p.pooling, call.inputs[0], call.outputs[0], call.scratch);
        },
        blocked_lrn_max_pool_scratch_floats(p.lrn, p.pooling));
  }

 private:
  LrnMaxPooling problem_;
};

}  // namespace

std::unique_ptr<Layer> make_lrn_max_pooling(const LrnMaxPooling& problem) {
  return std::make_unique<LrnMaxPoolingLayer>(problem);
}

}  // namespace revisit::engine
