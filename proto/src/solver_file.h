#pragma once

#include <filesystem>
#include <optional>
#include <string>

#include "caffe_schema.pb.h"

namespace revisit::proto {

struct SolverNet {
  std::filesystem::path file;  // exists
  caffe::NetState state;       // stages and level for testing the net
};

/// Returns the single net that a solver file names, or nullopt if the text is not a solver file.
/// Relative paths start at the solver's folder, else at the working folder (Caffe's rule). Throws
/// InputError if it names several nets, embeds one, or the net does not exist.
std::optional<SolverNet> net_of_solver(const std::string& text,
                                       const std::filesystem::path& solver);

}  // namespace revisit::proto
