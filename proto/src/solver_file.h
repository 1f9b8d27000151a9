#pragma once

#include <filesystem>
#include <optional>
#include <string>

#include "caffe_schema.pb.h"

namespace revisit::proto {

/// What a solver file says about the net.
struct SolverNet {
  std::filesystem::path file;  // found on disk
  caffe::NetState state;       // the stages and level it tests the net with
};

/// The one net that a solver file names, or nothing for a text that is not a solver file. Relative
/// paths are looked for beside the solver, then in the working folder (Caffe's own rule).
/// Throws InputError when it names several nets, has one inside, or the net is not there.
std::optional<SolverNet> net_of_solver(const std::string& text,
                                       const std::filesystem::path& solver);

}  // namespace revisit::proto
