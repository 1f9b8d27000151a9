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

/// Marks a layer with an error. `index` is its index in the file's `layers`, or -1 if unknown.
using Blame = std::function<void(google::protobuf::Message& layer, std::string reason, int index)>;

enum class ShapelessInputs {
  kDropped,  // removed, by Caffe's rule: the upgraded file equals Caffe's
  kKept      // becomes an Input layer without a shape, which the loader may know
};

/// Upgrades a net of any generation to V2, in Caffe's order. Throws UpgradeError for errors of the
/// net; errors of layers go to `blame`.
void upgrade(caffe::NetParameter& net, ShapelessInputs inputs, const Blame& blame,
             std::vector<std::string>& warnings);

}  // namespace revisit::proto
