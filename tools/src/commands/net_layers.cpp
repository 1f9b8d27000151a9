#include <iostream>

#include "cli/table.h"
#include "net_commands.h"
#include "revisit/engine/net.h"

namespace revisit::cli {

namespace {

struct LayersOptions {
  std::string format = "table";

  void declare(Options& options) {
    options.choice("format", {"table", "csv", "markdown"},
                   "format of standard output (default table)", &format);
  }
};

int list_layers(LayersOptions& o) {
  Table table({"type", "from", "does"});
  for (const engine::LayerType& layer : engine::layer_types())
    table.row({layer.type, layer.origin, layer.does});
  if (o.format == "table") {
    table.print(std::cout);
  } else if (o.format == "csv") {
    table.print_csv(std::cout);
  } else {
    std::cout << "| type | from | does |\n|---|---|---|\n";
    for (const engine::LayerType& layer : engine::layer_types())
      std::cout << "| " << layer.type << " | " << layer.origin << " | " << layer.does << " |\n";
  }
  return kOk;
}

}  // namespace

Command net_layers_command() {
  return {"layers", "supported layer types", "Lists the supported layer types.",
          "  revisit net layers\n  revisit net layers --format markdown\n",
          with_options<LayersOptions>(list_layers)};
}

}  // namespace revisit::cli
