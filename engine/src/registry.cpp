#include <strings.h>

#include <algorithm>

#include "layers/layers.h"
#include "revisit/proto/net_file.h"

namespace revisit::engine {
namespace {

const std::vector<LayerEntry>& table() {
  static const std::vector<LayerEntry> kTable = [] {
    std::vector<LayerEntry> all;
    for (const LayerEntries& of_file : {kBatchNormLayers,   kBoxOutputLayers,
                                        kConvolutionLayers, kDummyDataLayers,
                                        kElementwiseLayers, kInnerProductLayers,
                                        kJoinAndCutLayers,  kLabelsLayers,
                                        kNormalizeLayers,   kPermuteLayers,
                                        kPoolingLayers,     kProposalLayers,
                                        kRecurrentLayers,   kReductionLayers,
                                        kReshapeLayers,     kResizeLayers,
                                        kRoiPoolingLayers,  kRowsLayers,
                                        kScaleLayers,       kSequencesLayers,
                                        kSsdLayers,         kYoloDetectionOutputLayers})
      all.insert(all.end(), of_file.begin(), of_file.end());
    return all;
  }();
  return kTable;
}

const LayerEntry* entry_of(const std::string& type) {
  const auto entry = std::ranges::find(table(), type, &LayerEntry::type);
  return entry == table().end() ? nullptr : &*entry;
}

}  // namespace

bool is_supported(const std::string& type) {
  return type == kInputType || entry_of(type);
}

void check_type(const caffe::LayerParameter& param) {
  if (is_supported(param.type())) return;
  if (param.type().empty()) throw InputError("has no type; give it one, e.g. type: \"ReLU\"");
  std::vector<std::string> known;
  for (const LayerType& type : layer_types()) known.push_back(type.type);
  const std::string fork = proto::fork_of(param.type());
  const std::string hint =
      fork.empty() ? misspelling_hint(param.type(), known) : str("; it is of ", fork);
  if (param.type() == "Python")
    throw UnsupportedError("layers of type 'Python' run in revisit.caffe only");
  if (param.bottom_size() == 0 && param.top_size() > 0)
    throw UnsupportedError("layer type '", param.type(), "' is not supported", hint,
                           "; it reads no blob: if it reads data, write an Input layer instead");
  throw UnsupportedError(
      "layer type '", param.type(), "' is not supported", hint,
      "; end the net before it, or write it as a Python layer for revisit.caffe");
}

std::unique_ptr<Layer> make_layer(const caffe::LayerParameter& param) {
  check_type(param);
  return param.type() == kInputType ? nullptr : entry_of(param.type())->make(param);
}

std::string ambiguity_of(const caffe::LayerParameter& param) {
  if (param.type() == "Reverse" && param.reverse_param().axis().empty())
    return "along axis 0, as in CTPN; the Reverse of Synopsys' fork is the identity without an "
           "axis";
  const LayerEntry* const entry = entry_of(param.type());
  return entry && entry->other_forks ? entry->other_forks : "";
}

std::vector<LayerType> layer_types() {
  std::vector<LayerType> types{{kInputType, "Caffe", "an input of the net"}};
  for (const LayerEntry& entry : table()) types.push_back({entry.type, entry.origin, entry.does});
  std::stable_sort(types.begin(), types.end(), [](const LayerType& a, const LayerType& b) {
    return strcasecmp(a.type.c_str(), b.type.c_str()) < 0;
  });
  return types;
}

std::set<std::string> types_with_weights() {
  std::set<std::string> types;
  for (const LayerEntry& entry : table())
    if (entry.has_weights) types.insert(entry.type);
  return types;
}

}  // namespace revisit::engine
