#include <algorithm>

#include "revisit/engine/net.h"
#include "subject.h"

namespace revisit::bench {
namespace {

engine::Plan plan(const Model& model, const Setting& setting) {
  engine::PlanOptions options{.threads = setting.threads};
  if (setting.gray) options.channel_offsets = std::vector<float>(model.input()[1], 0.0F);
  return engine::Net::load(model.prototxt, model.weights)
      .plan({{model.input_name, model.input()}}, options);
}

class Ours : public Subject {
 public:
  Ours(const Model& model, const Setting& setting, std::span<const float> input)
      : output_name_(model.output_name()), run_(plan(model, setting)) {
    const auto to = run_.input(model.input_name).values();
    std::copy_n(input.begin(), to.size(), to.begin());
  }

  std::string name() const override { return "revisit"; }
  void forward() override { run_.forward(); }
  std::vector<double> timed_forward() override {
    std::vector<double> times(run_.plan().layers().size(), 0);
    double start = 0;
    run_.forward([&](size_t layer, bool done) {
      if (done)
        times[layer] += now_ms() - start;
      else
        start = now_ms();
    });
    return times;
  }
  std::span<const float> output() const override { return run_.output(output_name_).values(); }

 private:
  std::string output_name_;
  engine::Run run_;
};

}  // namespace

std::unique_ptr<Subject> make_ours(const Model& model, const Setting& setting,
                                   std::span<const float> input) {
  return std::make_unique<Ours>(model, setting, input);
}

}  // namespace revisit::bench
