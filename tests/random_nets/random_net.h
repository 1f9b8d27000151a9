#pragma once

#include <map>
#include <optional>
#include <string>
#include <vector>

#include "caffe_schema.pb.h"
#include "revisit/engine/net.h"

/// Randomly generated valid nets, over all layer types of the registry.
namespace revisit::random_nets {

/// Size of an input's axis: `factor` times one of the net's sizes, times axes of blobs as they are
/// where the input is declared.
struct Size {
  struct Axis {
    std::string blob;
    size_t axis;
  };
  int64_t factor = 1;
  std::optional<size_t> slot = {};  // of RandomNet::sizes
  std::vector<Axis> axes = {};
};

enum class Fill {
  kNumbers,
  kIndices,  // whole numbers from 0 to below `bound`
  kFlags,    // 0 or 1
  kRegions,  // of images below `bound`: image, x1, y1, x2, y2 [pixels]
};

struct Input {
  std::vector<Size> axes;
  Fill fill = Fill::kNumbers;
  Size bound = {};
};

struct RandomNet {
  uint64_t seed = 0;
  caffe::NetParameter net;              // its layers hold their weights
  std::map<std::string, Input> inputs;  // by blob
  std::string end, graft;               // LoadOptions
  std::vector<float> channel_offsets;   // of the only input's channels; empty: no gray input
  /// Two sets of sizes that inputs refer to, for two plans of the net.
  std::vector<std::vector<int64_t>> sizes;
};

/// Deterministic. Throws std::logic_error if the engine rejects the net.
RandomNet make_random_net(uint64_t seed);

/// Shapes of all inputs for these sizes, and the bounds of their values. Throws InputError if a
/// layer cannot take the shapes.
struct InputShapes {
  std::map<std::string, engine::Shape> shapes;
  std::map<std::string, int64_t> bounds;
};
InputShapes input_shapes(const RandomNet& net, const std::vector<int64_t>& sizes);

/// Returns whether fast kernels may round differently than the reference; false for layers that
/// only select, compare or move values.
bool rounds(const caffe::LayerParameter& layer);

/// Maximum amplification of the mean's rounding error in a layer that subtracts a mean, else 0.
double mean_gain(const caffe::LayerParameter& layer);

std::string text_of(const RandomNet& net);

void write(const RandomNet& net, const std::filesystem::path& folder);

}  // namespace revisit::random_nets
