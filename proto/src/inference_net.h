#pragma once

#include <map>
#include <set>
#include <string>
#include <vector>

#include "caffe_schema.pb.h"
#include "upgrade.h"

namespace revisit::proto {

/// Reduces a V2 net to what inference runs: the layers of the TEST phase and, of a net that reads
/// training data (a train_val.prototxt), the part between data and prediction. Then data layers
/// become Input layers, of the shape the file says, if it does; losses, Accuracy and what only
/// serves them (labels) are left out; the only SoftmaxWithLoss becomes the Softmax a deploy
/// prototxt has in its place. Nets without data layers keep all that Caffe itself would run.
/// Outputs of `types_with_weights` were learned: they are predictions, not labels.
/// Each thing done is said in `warnings`; contradictory phase rules are their layer's.
/// Returns what became of the layers of training, by name.
std::map<std::string, std::string> keep_inference(caffe::NetParameter& net,
                                                  const std::set<std::string>& types_with_weights,
                                                  const Blame& blame,
                                                  std::vector<std::string>& warnings);

}  // namespace revisit::proto
