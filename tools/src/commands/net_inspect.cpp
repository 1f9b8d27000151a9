#include "net_commands.h"

namespace revisit::cli {

namespace {

struct InspectOptions {
  NetOptions net;
  std::string format = "table";
  std::filesystem::path graph;
  bool memory = false;

  void declare(Options& options) {
    net.declare(options);
    options.group("Output:");
    options.flag("memory", "memory plan: every buffer of a run", &memory);
    options.option("graph", "FILE", "drawing of the graph, .dot or .svg (needs Graphviz)", &graph);
    options.choice("format", {"table", "json", "csv"}, "format of standard output (default table)",
                   &format);
  }
};

int inspect(InspectOptions& o) {
  const engine::Net loaded = load_net(o.net, NoWeights::kNone);
  const engine::Plan plan = loaded.plan({}, o.net.plan_options());
  if (!o.graph.empty()) write_graph(o.graph, loaded, plan);
  print_net_report(
      net_report({o.net, weights_source(o.net, NoWeights::kNone), loaded, plan, o.memory}),
      o.format);
  return kOk;
}

}  // namespace

Command net_inspect_command() {
  return {"inspect", "layers, shapes, parameters, MACs and memory",
          "Prints the layers of a Caffe net: shapes, parameters, multiply-accumulates, memory and "
          "receptive field, for the input size of the file or another. With WEIGHTS it also checks "
          "their shapes. Receptive field: output pixel i depends on input pixels start + i * "
          "stride to start + i * stride + size - 1; '19x19 /8,8 @0,0' is size, stride, start of "
          "rows and columns.",
          "  revisit net inspect deploy.prototxt\n"
          "  revisit net inspect alexnet.prototxt --input-shape 1x3x107x4000 --end conv3 --graft "
          "pool5\n"
          "  revisit net inspect deploy.prototxt --graph net.svg --memory\n"
          "  revisit net inspect deploy.prototxt model.caffemodel --format json\n",
          with_options<InspectOptions>(inspect)};
}

}  // namespace revisit::cli
