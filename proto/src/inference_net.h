#pragma once

#include <map>
#include <set>
#include <string>
#include <vector>

#include "caffe_schema.pb.h"
#include "revisit/proto/net_file.h"
#include "upgrade.h"

namespace revisit::proto {

/// Reduces a V2 net to inference: the layers of the state and, if it reads training data (a
/// train_val.prototxt), the part between data and prediction. Data layers become Input layers, with
/// a shape if the file has one. Losses, Accuracy and label layers are skipped. A sole
/// SoftmaxWithLoss becomes the Softmax of a deploy prototxt. Values that depend on
/// `types_with_weights` are predictions, not labels. Returns the fate of training layers, by name.
std::map<std::string, std::string> keep_inference(caffe::NetParameter& net,
                                                  const NetReadOptions& options,
                                                  const std::set<std::string>& types_with_weights,
                                                  const Blame& blame,
                                                  std::vector<std::string>& warnings);

}  // namespace revisit::proto
