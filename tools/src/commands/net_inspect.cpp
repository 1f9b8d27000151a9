#include "net_commands.h"

namespace revisit::cli {

int net_inspect_command(const Arguments& arguments) {
  NetOptions options;
  std::string format = "table";
  std::filesystem::path graph;
  bool memory = false;
  Parser parser("revisit net inspect", "PROTOTXT [WEIGHTS]",
                "Prints the layers of a Caffe net: shapes, parameters, multiply-accumulates, "
                "memory and receptive field, "
                "for the input size of the file or another. With WEIGHTS it also checks their "
                "shapes. Receptive field: "
                "output pixel i depends on input pixels start + i * stride to start + i * stride + "
                "size - 1; '19x19 "
                "/8,8 @0,0' is size, stride, start of rows and columns.",
                "  revisit net inspect deploy.prototxt\n"
                "  revisit net inspect alexnet.prototxt --input-shape 1x3x107x4000 --end conv3 "
                "--graft pool5\n"
                "  revisit net inspect deploy.prototxt --graph net.svg --memory\n"
                "  revisit net inspect deploy.prototxt model.caffemodel --format json\n");
  options.declare(parser);
  parser.group("Output:");
  parser.flag("memory", "memory plan: every buffer of a run", &memory);
  parser.option("graph", "FILE", "drawing of the graph, .dot or .svg (needs Graphviz)", &graph);
  parser.choice("format", {"table", "json", "csv"}, "format of standard output (default table)",
                &format);
  parser.parse(arguments);

  const engine::Net net = load_net(options, NoWeights::kNone);
  const engine::Plan plan = net.plan({}, options.plan_options());
  if (!graph.empty()) write_graph(graph, net, plan);
  print_net_report(
      net_report({options, weights_source(options, NoWeights::kNone), net, plan, memory}), format);
  return kOk;
}

}  // namespace revisit::cli
