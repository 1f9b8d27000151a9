#include "net_case.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstring>
#include <random>

#include "testing.h"

namespace revisit::test {

engine::Net small_net(const engine::Shape& data, const std::string& layers, const std::string& end,
                      Weights weights) {
  std::string dims;
  for (const int64_t size : data.axes()) dims += " dim: " + std::to_string(size);
  const TempDir dir;
  write_file(dir / "net.prototxt",
             "layer { name: 'data' type: 'Input' top: 'data' input_param { shape {" + dims +
                 " } } }\n" + layers);
  const size_t plus = end.find('+');
  const engine::LoadOptions options{.end = end.substr(0, plus),
                                    .graft = plus == std::string::npos ? "" : end.substr(plus + 1)};
  return weights == Weights::kNone
             ? engine::Net::load_without_weights(dir / "net.prototxt", options)
             : engine::Net::load_with_random_weights(dir / "net.prototxt", 1, options);
}

std::string conv(const std::string& name, const std::string& bottom, const std::string& param) {
  return layer(name, "Convolution", {bottom}, "convolution_param { " + param + " }");
}

std::string layer(const std::string& name, const std::string& type,
                  const std::vector<std::string>& bottoms, const std::string& param) {
  std::string text = "layer { name: '" + name + "' type: '" + type + "' ";
  for (const std::string& bottom : bottoms) text += "bottom: '" + bottom + "' ";
  return text + "top: '" + name + "' " + param + " }\n";
}

std::string in_place(const std::string& name, const std::string& type, const std::string& blob,
                     const std::string& param) {
  return "layer { name: '" + name + "' type: '" + type + "' bottom: '" + blob + "' top: '" + blob +
         "' " + param + " }\n";
}

void fill_randomly(engine::Run& run, unsigned seed) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<float> uniform(-1, 1);
  for (const engine::Port& port : run.plan().inputs())
    for (float& value : run.input(port.name).values()) value = uniform(random);
}

std::map<std::string, engine::Tensor> forward(const engine::Net& net,
                                              const engine::PlanOptions& options, unsigned seed) {
  engine::Run run(net.plan({}, options));
  fill_randomly(run, seed);
  run.forward();
  std::map<std::string, engine::Tensor> outputs;
  for (const engine::Port& port : run.plan().outputs()) {
    const auto view = run.output(port.name);
    outputs[port.name] = {view.shape, {view.values().begin(), view.values().end()}};
  }
  return outputs;
}

double tolerance_of(const engine::Plan& plan, double otherwise) {
  const bool winograd = std::ranges::any_of(plan.layers(), &engine::LayerCost::winograd);
  return winograd ? 1e-4 : otherwise;
}

engine::Plan expect_as_reference(const engine::Net& net, engine::PlanOptions options) {
  const double tolerance = tolerance_of(net.plan({}, options));
  engine::PlanOptions reference;
  reference.reference_kernels = true;
  const auto wanted = forward(net, reference);
  const auto found = forward(net, options);
  EXPECT_EQ(found.size(), wanted.size());
  for (const auto& [name, tensor] : wanted)
    EXPECT_LE(relative_error(found.at(name).values, tensor.values), tolerance) << name;
  options.threads = 3;
  for (const auto& [name, tensor] : forward(net, options))
    EXPECT_EQ(std::memcmp(tensor.values.data(), found.at(name).values.data(),
                          tensor.values.size() * sizeof(float)),
              0)
        << name << " on three threads";
  options.threads = 1;
  return net.plan({}, options);
}

std::string kernel_of(const engine::Plan& plan, const std::string& layer) {
  for (const engine::LayerCost& cost : plan.layers())
    if (cost.name == layer) return cost.kernel;
  ADD_FAILURE() << "no layer " << layer;
  return "";
}

}  // namespace revisit::test
