#include <algorithm>

#include "revisit/engine/net.h"
#include "subject.h"

namespace revisit::bench {
namespace {

class Ours : public Subject {
 public:
  Ours(const Model& model, const Setting& setting, std::span<const float> input)
      : output_name_(model.output_name()),
        run_(engine::Net::load(model.prototxt, model.weights)
                 .plan({{model.input_name, model.input()}}, {.threads = setting.threads})) {
    const auto to = run_.input(model.input_name).values();
    std::copy_n(input.begin(), to.size(), to.begin());
  }

  std::string name() const override { return "revisit"; }
  void forward() override { run_.forward(); }
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
