#pragma once

#include <stdexcept>
#include <string>
#include <vector>

#include "caffe.pb.h"

namespace revisit::proto {

/// A net that cannot be upgraded, because of entry `index` of NetParameter's `field` as the file
/// has it. Becomes an InputError once the line is known.
struct UpgradeError : std::runtime_error {
  UpgradeError(std::string field_name, int field_index, const std::string& reason)
      : std::runtime_error(reason), field(std::move(field_name)), index(field_index) {}
  std::string field;
  int index;
};

/// Brings a net of any generation to V2, in Caffe's order. Throws UpgradeError.
void upgrade(caffe::NetParameter& net, std::vector<std::string>& warnings);

}  // namespace revisit::proto
