#include <iostream>

#include "cli/table.h"
#include "net_commands.h"
#include "revisit/engine/net.h"

namespace revisit::cli {

int net_layers_command(const Arguments& arguments) {
  std::string format = "table";
  Parser parser("revisit net layers", "", "Lists the supported layer types.",
                "  revisit net layers\n  revisit net layers --format markdown\n");
  parser.choice("format", {"table", "csv", "markdown"}, "format of standard output (default table)",
                &format);
  parser.parse(arguments);

  Table table({"type", "from", "does"});
  for (const engine::LayerType& layer : engine::layer_types())
    table.row({layer.type, layer.origin, layer.does});
  if (format == "table") {
    table.print(std::cout);
  } else if (format == "csv") {
    table.print_csv(std::cout);
  } else {
    std::cout << "| type | from | does |\n|---|---|---|\n";
    for (const engine::LayerType& layer : engine::layer_types())
      std::cout << "| " << layer.type << " | " << layer.origin << " | " << layer.does << " |\n";
  }
  return kOk;
}

}  // namespace revisit::cli
