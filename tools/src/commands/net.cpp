#include "revisit/engine/net.h"

#include <iostream>

#include "cli/command.h"
#include "cli/shell.h"
#include "cli/terminal.h"
#include "net_commands.h"
#include "revisit/base/files.h"

namespace revisit::cli {
namespace {

namespace fs = std::filesystem;

std::string escaped(const std::string& text) {
  std::string result;
  for (const char c : text) {
    if (c == '"' || c == '\\') result += '\\';
    result += static_cast<unsigned char>(c) < ' ' ? ' ' : c;
  }
  return result;
}

const char* color_of(const std::string& type) {
  if (type == "Input") return "#dddddd";
  if (type.find("onvolution") != std::string::npos || type == "InnerProduct") return "#9ecae1";
  if (type == "Pooling") return "#a1d99b";
  if (type == "Concat" || type == "Eltwise" || type == "Slice" || type == "Split") return "#fdd0a2";
  return "#ffffff";
}

void write_dot(std::ostream& out, const engine::Net& net, const engine::Plan& plan) {
  out << "digraph \"" << escaped(net.name()) << "\" {\n"
      << "  node [shape=box, style=\"rounded,filled\", fontname=\"Helvetica\", fontsize=11];\n"
      << "  edge [fontname=\"Helvetica\", fontsize=9];\n";
  const std::vector<engine::LayerCost>& layers = plan.layers();
  for (size_t i = 0; i < layers.size(); ++i) {
    const engine::LayerCost& layer = layers[i];
    const std::string shape = layer.outputs.empty() ? "" : layer.outputs[0].text();
    const std::string label =
        "\"" + escaped(layer.name) + "\\n" + escaped(layer.type) + "\\n" + shape + "\"";
    out << "  n" << i << " [label=" << label << ", fillcolor=\"" << color_of(layer.type)
        << "\"];\n";
  }
  for (size_t i = 0; i < layers.size(); ++i)
    for (size_t input = 0; input < layers[i].input_layers.size(); ++input)
      out << "  n" << layers[i].input_layers[input] << " -> n" << i << " [label=\""
          << layers[i].inputs[input] << "\"];\n";
  out << "}\n";
}

/// `file`: .dot, or .svg by Graphviz. Throws UsageError for others, Error if drawing fails.
void write_graph(const fs::path& file, const engine::Net& net, const engine::Plan& plan) {
  const std::string ending = file.extension();
  if (ending != ".dot" && ending != ".svg")
    throw UsageError("--graph: expected a name that ends with .dot or .svg, found '", file.string(),
                     "'");
  const fs::path dot = fs::path(file).replace_extension(".dot");
  write_atomically(dot, [&](std::ostream& out) { write_dot(out, net, plan); });
  if (ending == ".dot") return;
  const int code =
      run_program({"dot", "-Tsvg", "-o", fs::absolute(file), fs::absolute(dot)}, "graphviz");
  if (code != 0)
    throw Error("--graph: dot failed with exit code ", code, "; ", dot.string(),
                " holds the graph");
}

void print_layer_types(bool csv) {
  Table table({"type", "from", "does"});
  for (const engine::LayerType& layer : engine::layer_types())
    table.row({layer.type, layer.origin, layer.does});
  csv ? table.print_csv(std::cout) : table.print(std::cout);
}

struct InspectOptions {
  NetOptions net;
  std::string format = "table";
  fs::path graph;
  bool memory = false, layers = false;

  void declare(Options& options) {
    net.declare(options, false);
    options.group("Output:");
    options.flag("layers", "only the supported layer types; needs no PROTOTXT", &layers);
    options.flag("memory", "memory plan: every buffer of a run", &memory);
    options.option("graph", "FILE", "drawing of the graph, .dot or .svg (needs Graphviz)", &graph);
    options.format({"table", "json", "csv"}, &format);
    options.check([this] {
      if (net.prototxt.empty() && !layers) throw UsageError("missing argument PROTOTXT");
    });
  }
};

int inspect(InspectOptions& o) {
  if (o.layers) {
    print_layer_types(o.format == "csv");
    return kOk;
  }
  const engine::Net loaded = load_net(o.net, NoWeights::kNone);
  const engine::Plan plan = loaded.plan({}, o.net.plan_options());
  if (!o.graph.empty()) write_graph(o.graph, loaded, plan);
  print_net_report(
      net_report({o.net, weights_source(o.net, NoWeights::kNone), loaded, plan, o.memory}),
      o.format);
  return kOk;
}

Command net_inspect_command() {
  return {"inspect", "layers, shapes, parameters, MACs and memory",
          "Prints the layers of a Caffe net: shapes, parameters, multiply-accumulates, memory and "
          "receptive field, for the input size of the file or another. With WEIGHTS it also checks "
          "their shapes. Receptive field: output pixel i depends on input pixels start + i * "
          "stride to start + i * stride + size - 1; '19x19 /8,8 @0,0' is size, stride, start of "
          "rows and columns.",
          "  revisit net inspect deploy.prototxt\n"
          "  revisit net inspect alexnet.prototxt --input-shape 1x3x107x4000 --end conv3+pool5\n"
          "  revisit net inspect deploy.prototxt --graph net.svg --memory\n"
          "  revisit net inspect deploy.prototxt model.caffemodel --format json\n"
          "  revisit net inspect --layers\n",
          with_options<InspectOptions>(inspect)};
}

}  // namespace

Command net_command() {
  return {"net",
          "run a Caffe net: inspect, forward, profile, verify",
          "Run a Caffe net from its original .prototxt and .caffemodel.\n",
          "",
          {},
          {net_inspect_command(), net_forward_command(), net_profile_command(),
           net_verify_command(), net_upgrade_command()}};
}

}  // namespace revisit::cli
