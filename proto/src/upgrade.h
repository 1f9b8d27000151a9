#pragma once

#include <functional>
#include <string>
#include <vector>

#include "caffe_schema.pb.h"
#include "revisit/base/error.h"

namespace revisit::proto {

/// A net that cannot be upgraded, because of entry `index` of NetParameter's `field` as the file
/// has it. Becomes an InputError once the line is known.
struct UpgradeError : Error {
  template <class... Parts>
  UpgradeError(std::string field_name, int field_index, const Parts&... reason)
      : Error(reason...), field(std::move(field_name)), index(field_index) {}
  std::string field;
  int index;
};

/// Keeps what is wrong with a layer for whoever needs the layer, with which its mark goes along.
/// `index` is the place of the layer in the file's `layers`; -1 where that is not known.
using Blame = std::function<void(google::protobuf::Message& layer, std::string reason, int index)>;

/// What becomes of an `input` without a shape that a layer reads.
enum class ShapelessInputs {
  kDropped,  // Caffe's rule: the upgraded file is the original's
  kKept      // an Input layer without a shape: the loader may know it
};

/// Brings a net of any generation to V2, in Caffe's order. Throws UpgradeError for what is wrong
/// with the net, not with one of its layers.
void upgrade(caffe::NetParameter& net, ShapelessInputs inputs, const Blame& blame,
             std::vector<std::string>& warnings);

}  // namespace revisit::proto
