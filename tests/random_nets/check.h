#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "random_net.h"

namespace revisit::random_nets {

struct Statistics {
  int64_t nets = 0;
  int64_t outputs = 0;      // compared with the reference, over all plans
  int64_t insensitive = 0;  // among them: tolerance above 1 % of the values
  int64_t too_large = 0;    // nets with NaN or (nearly) infinite values, which are not compared
  int64_t other_shapes = 0, gray = 0, truncated = 0;  // nets
};

/// Runs a net in all ways that must give equal results: reference kernels, every instruction set,
/// with and without keep_all, single-channel or full input. Other ways are 1, 2, 3, 7 and 16
/// threads, runs within other threads, and runs concurrent with a plan for other shapes. Returns
/// the fault, or "".
///
/// Values are compared with the reference per channel. The tolerance is measured: the reference
/// runs again with noise of the kernels' allowed rounding error (tests/golden/README.md) added to
/// the output of every rounding layer. Outputs without an earlier rounding layer must be bitwise
/// equal.
std::string find_fault(const RandomNet& net, Statistics& statistics);

/// Returns "", or the fault with its seed and the net. A rejected net is a fault, too.
std::string find_fault(uint64_t seed, Statistics& statistics);

/// Writes the net of a seed and the inputs of find_fault() for another program:
///   net.prototxt, net.caffemodel, truncation.txt   the last: --end and --graft, a line each
///   0/in_BLOB.npy, 1/in_BLOB.npy                   for one or two sets of sizes
///   N/PORT.npy, N/PORT.off.npy                     reference output of each layer, and its
///                                                  tolerance per channel
/// If values are NaN or near infinity, N/ has only the inputs.
void save(uint64_t seed, const std::filesystem::path& folder);

}  // namespace revisit::random_nets
