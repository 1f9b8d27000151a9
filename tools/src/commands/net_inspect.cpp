#include "net_commands.h"

namespace revisit::cli {

int net_inspect_command(const Arguments& arguments) {
  NetOptions options;
  std::string format = "table";
  Parser parser("revisit net inspect", "PROTOTXT [WEIGHTS]",
                "Show the layers of a Caffe net with shapes, parameters, multiply-accumulates and "
                "memory, for the "
                "input size of the file or any other. With WEIGHTS, also check that they fit.",
                "  revisit net inspect deploy.prototxt\n"
                "  revisit net inspect alexnet.prototxt --input-shape 1x3x107x4000 --end conv3 "
                "--graft pool5\n"
                "  revisit net inspect deploy.prototxt model.caffemodel --format json\n");
  options.declare(parser);
  parser.option("format", "FORMAT", "table, json or csv", &format);
  parser.parse(arguments);

  const engine::Net net = load_net(options, NoWeights::kNone);
  const engine::Plan plan = net.plan({}, {.threads = options.threads});
  print_net_report(
      net_report(options, weights_source(options, NoWeights::kNone), net, plan, nullptr), format);
  return kOk;
}

}  // namespace revisit::cli
