#include "cli/run_program.h"
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

}  // namespace

void write_graph(const fs::path& file, const engine::Net& net, const engine::Plan& plan) {
  const std::string ending = file.extension();
  if (ending != ".dot" && ending != ".svg")
    throw UsageError("--graph: expected a name that ends with .dot or .svg, found '", file.string(),
                     "'");
  const fs::path dot = fs::path(file).replace_extension(".dot");
  write_atomically(dot, [&](std::ostream& out) { write_dot(out, net, plan); });
  if (ending == ".dot") return;
  const fs::path absolute = fs::absolute(dot);
  const std::string problem = run_program(
      absolute.parent_path(),
      {"dot", "-Tsvg", "-o", absolute.filename().replace_extension(".svg"), absolute.filename()},
      "graphviz");
  if (!problem.empty()) throw Error("--graph: ", problem, "; ", dot.string(), " holds the graph");
}

}  // namespace revisit::cli
