#include <algorithm>
#include <cmath>

#include "cli/built_in.h"
#include "doctor/checks.h"
#include "revisit/base/error.h"
#include "revisit/engine/net.h"
#include "revisit/proto/net_file.h"
#include "revisit/recognition/optional_library.h"
#include "revisit/weights_conversion/random_model.h"
#include "revisit/weights_conversion/trunks.h"

namespace revisit::doctor {
namespace {

std::vector<float> forward(const engine::Net& net, bool reference_kernels) {
  const engine::Shape input{1, 3, 67, 131};  // small, and no multiple of any block size
  engine::Run run(net.plan({{"data", input}}, {.reference_kernels = reference_kernels}));
  const engine::View<float> data = run.input("data");
  size_t i = 0;
  for (float& value : data.values()) value = static_cast<float>((i++ * 37) % 256) - 128;
  run.forward();
  const auto output = run.output(net.outputs().at(0)).values();
  return {output.begin(), output.end()};
}

/// max|fast - reference| / max|reference|, or NaN if an output is NaN.
double deviation_from_reference() {
  const auto net = engine::Net::load_from_memory(
      proto::net_text(models::trunk("alexnet")),
      models::random_model("alexnet", 1).SerializeAsString(), {.truncation = {"conv3", "pool5"}});
  const std::vector<float> fast = forward(net, false), truth = forward(net, true);
  double difference = 0, largest = 0;
  for (size_t i = 0; i < truth.size(); ++i) {
    const double error = std::abs(double{fast.at(i)} - double{truth[i]});
    if (std::isnan(error)) return error;
    difference = std::max(difference, error);
    largest = std::max(largest, std::abs(double{truth[i]}));
  }
  return difference / largest;
}

Check self_test() {
  constexpr double kTolerance = 1e-4;
  Check check{"program", "self-test", Status::kMissing, "", "", true};
  try {
    const double deviation = deviation_from_reference();
    const bool good = deviation <= kTolerance;
    check.found = str("AlexNet's first layers, fast kernels against the reference: ", deviation);
    if (good)
      check.status = Status::kOk;
    else
      check.advice = "the results of networks are wrong on this machine; please report this output";
  } catch (const std::exception& error) {
    check.found = error.what();
    check.advice = "networks do not run on this machine; please report this output";
  }
  return check;
}

std::string build_text() {
#ifdef NDEBUG
  const char* const checks = "without assertions";
#else
  const char* const checks = "with assertions";
#endif
#ifdef __OPTIMIZE__
  const char* const optimized = "optimized";
#else
  const char* const optimized = "not optimized";
#endif
  return str("g++ ", __VERSION__, ", ", optimized, ", ", checks);
}

}  // namespace

void check_program(Checks& checks) {
  checks.push_back({"program", "revisit", Status::kOk, REVISIT_VERSION});
#ifdef __OPTIMIZE__
  checks.push_back({"program", "build", Status::kOk, build_text()});
#else
  checks.push_back({"program", "build", Status::kWarn, build_text(),
                    "many times slower; build with 'cmake --preset release'"});
#endif
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
  checks.push_back({"program", "sanitizers", Status::kWarn, "on", "for tests only: slow"});
#endif
  for (const OptionalLibrary& library : optional_libraries())
    checks.push_back({"program", std::string(library.name),
                      library.built_in ? Status::kOk : Status::kMissing,
                      str(library.built_in ? "built in: " : "not built in: ", library.use),
                      library.built_in ? "" : cli::how_to_complete()});
  checks.push_back(self_test());
}

}  // namespace revisit::doctor
