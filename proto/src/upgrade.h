#pragma once

#include <functional>
#include <string>
#include <vector>

#include "caffe_schema.pb.h"
#include "revisit/base/error.h"

namespace revisit::proto {

/// A net that cannot be upgraded, because of entry `index` of NetParameter's `field` in the file.
/// Callers rethrow it as InputError with the line.
struct UpgradeError : Error {
  template <class... Parts>
  UpgradeError(std::string field_name, int field_index, const Parts&... reason)
      : Error(reason...), field(std::move(field_name)), index(field_index) {}
  std::string field;
  int index;
};

/// Records an error of a layer for callers that need the layer, by a mark on it. `index` is the
/// layer's index in the file's `layers`, or -1 if unknown.
using Blame = std::function<void(google::protobuf::Message& layer, std::string reason, int index)>;

/// Handling of an `input` without a shape that a layer reads.
enum class ShapelessInputs {
  kDropped,  // removed, by Caffe's rule: the upgraded file equals Caffe's
  kKept      // becomes an Input layer without a shape, which the loader may know
};

/// Upgrades a net of any generation to V2, in Caffe's order. Throws UpgradeError for errors of the
/// net; errors of layers go to `blame`.
void upgrade(caffe::NetParameter& net, ShapelessInputs inputs, const Blame& blame,
             std::vector<std::string>& warnings);

}  // namespace revisit::proto
