#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "random_net.h"

namespace revisit::random_nets {

struct Statistics {
  int64_t nets = 0;
  int64_t outputs = 0;      // compared with the reference, over all plans
  int64_t insensitive = 0;  // of these: with a tolerance above a hundredth of the values
  int64_t too_large = 0;    // nets with NaN, infinity or values near it, which are not compared
  int64_t other_shapes = 0, gray = 0, truncated = 0;  // nets
};

/// Runs a net in all ways that must give the same: with the reference kernels, with every set of
/// instructions, keeping all layers and not, gray or in full, on 1, 2, 3, 7 and 16 threads, within
/// other threads, alone and beside a plan for other shapes. Returns what is wrong, or nothing.
///
/// Numbers are compared with those of the reference channel by channel. How much rounding may show
/// in a channel is measured: the reference runs again with noise of the size that kernels may round
/// by (tests/golden/README.md) added to the output of every layer that rounds. Where no layer
/// before an output rounds, it must be the same to the last bit.
std::string find_fault(const RandomNet& net, Statistics& statistics);

/// The net with as few layers as still have a fault of the same kind, and the fault.
struct Shrunk {
  RandomNet net;
  std::string fault;
};
Shrunk shrink(const RandomNet& net, const std::string& fault);

/// What a person needs to see a fault again: the seed, the fault, and the shrunk net.
std::string describe(const RandomNet& net, const std::string& fault);

/// All of this for the net of one seed: nothing, or describe(). A net that is refused is a fault,
/// too.
std::string find_fault(uint64_t seed, Statistics& statistics);

/// Writes the net of a seed for another program that can run it, with the inputs of find_fault():
///   net.prototxt, net.caffemodel, truncation.txt   the last: --end and --graft, a line each
///   0/in_BLOB.npy, 1/in_BLOB.npy                   for one or two sets of sizes
///   N/PORT.npy, N/PORT.off.npy                     what the reference kernels give for each layer,
///                                                  and by how much rounding may change a channel
/// What has NaN or values near infinity is not written: only the inputs are then in N/.
void save(uint64_t seed, const std::filesystem::path& folder);

}  // namespace revisit::random_nets
