#include <cmath>
#include <cstdlib>
#include <iostream>

#include "cli/interrupt.h"
#include "net_commands.h"
#include "revisit/engine/blas.h"

namespace revisit::cli {
namespace {

/// A deterministic input of the size of pixel values about their mean: zeros would flatter kernels
/// that skip them, denormals would punish others.
void fill_input(const engine::View<float>& input) {
  int64_t i = 0;
  for (float& value : input.values())
    value = 100 * std::sin(0.37F * static_cast<float>(i++ % 9973));
}

/// Constants between the channels like those of colour means.
std::vector<float> some_offsets(const engine::Net& net) {
  std::vector<float> offsets;
  if (net.inputs().size() == 1 && net.inputs()[0].shape.rank() == 4)
    for (int64_t c = 0; c < net.inputs()[0].shape[1]; ++c)
      offsets.push_back(-10.0F * static_cast<float>(c));
  return offsets;
}

void warn_of_slow_settings() {
  const std::string faster = engine::faster_blas_core();
  if (!faster.empty())
    std::cerr << "warning: OpenBLAS uses its " << engine::blas_core()
              << " kernels, this CPU can run " << faster
              << "; unset OPENBLAS_CORETYPE or set it to " << faster << "\n";
  if (std::getenv("OPENBLAS_L2_SIZE"))
    std::cerr
        << "warning: OPENBLAS_L2_SIZE is set: OpenBLAS may block for another cache; unset it\n";
}

}  // namespace

int net_profile_command(const Arguments& arguments) {
  NetOptions options;
  engine::ProfileOptions measure;
  std::string format = "table";
  bool reference = false, gray = false;
  Parser parser("revisit net profile", "PROTOTXT [WEIGHTS]",
                "Time every layer of a Caffe net and the whole. Instrumented and uninstrumented "
                "passes alternate after "
                "a warm-up. Without WEIGHTS the net gets random ones: the time is the same.",
                "  revisit net profile alexnet.prototxt --input-shape 1x3x107x4000 --end conv3 "
                "--graft pool5\n"
                "  revisit net profile deploy.prototxt model.caffemodel --threads 2 --repeat 50 "
                "--format json\n");
  options.declare(parser);
  parser.group("Measurement:");
  parser.option("repeat", "R", "timed passes (default 20)", &measure.repeat);
  parser.option("warmup", "W", "passes before them (default 2)", &measure.warmup);
  parser.flag("gray",
              "as on range images: the input's channels are one picture, up to a constant each",
              &gray);
  parser.flag("reference", "time the slow reference kernels instead", &reference);
  parser.choice("format", {"table", "json", "csv"}, "form of the output (default table)", &format);
  parser.parse(arguments);
  if (measure.repeat < 1)
    throw UsageError(str("--repeat: expected at least 1, found ", measure.repeat));
  if (measure.warmup < 0)
    throw UsageError(str("--warmup: expected at least 0, found ", measure.warmup));
  measure.stop = interrupted;

  warn_of_slow_settings();
  const engine::Net net = load_net(options, NoWeights::kRandom);
  engine::PlanOptions plan_options = options.plan_options();
  plan_options.reference_kernels = reference;
  if (gray) plan_options.gray_offsets = some_offsets(net);
  const engine::Plan plan = net.plan({}, plan_options);
  engine::Run run(plan);
  for (const engine::Port& port : plan.inputs()) fill_input(run.input(port.name));
  const engine::Profile profile = engine::profile(run, measure);
  print_net_report(
      {options, weights_source(options, NoWeights::kRandom), net, plan, &profile, false}, format);
  return interrupted() ? kInterrupted : kOk;
}

}  // namespace revisit::cli
