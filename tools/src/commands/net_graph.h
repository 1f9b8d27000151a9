#pragma once

#include <filesystem>

#include "revisit/engine/net.h"

namespace revisit::cli {

/// Draws the graph of a plan: a node a layer with type, kernel size and output shape. `file` ends
/// with .dot (Graphviz text) or .svg (drawn by Graphviz's `dot`). Throws UsageError for another
/// ending, Error when the file cannot be written or `dot` is missing.
void write_graph(const std::filesystem::path& file, const engine::Net& net,
                 const engine::Plan& plan);

}  // namespace revisit::cli
