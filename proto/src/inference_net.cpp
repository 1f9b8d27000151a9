#include <algorithm>
#include <map>
#include <string_view>

#include "net_text.h"
#include "revisit/base/error.h"
#include "revisit/base/text.h"
#include "revisit/proto/net_file.h"
#include "upgrade.h"

namespace revisit::proto {
namespace {

using Layer = caffe::LayerParameter;
using Names = std::set<std::string_view>;

/// Returns whether a layer reads data: "Data", "HDF5Data", "ImageSegData", ... of Caffe and forks,
/// and scripts without bottoms, unless the caller executes them.
bool reads_data(const Layer& layer, bool keep_python) {
  if (layer.bottom_size() > 0 || layer.top_size() == 0) return false;
  if (layer.type() == "Python") return !keep_python;
  return layer.type().find("Data") != std::string::npos && layer.type() != "DummyData";
}

// Caffe and the forks SSD, Fast R-CNN, DeepLab.
const Names kTrainingTypes = {"Accuracy",
                              "ContrastiveLoss",
                              "EuclideanLoss",
                              "HDF5Output",
                              "HingeLoss",
                              "InfogainLoss",
                              "MultinomialLogisticLoss",
                              "SigmoidCrossEntropyLoss",
                              "Silence",
                              "SoftmaxWithLoss",
                              "MultiBoxLoss",
                              "DetectionEvaluate",
                              "SmoothL1Loss",
                              "SegAccuracy"};

/// Caffe's StateMeetsRule.
bool meets(const caffe::NetState& state, const caffe::NetStateRule& rule) {
  const auto has_stage = [&](const std::string& stage) {
    return std::find(state.stage().begin(), state.stage().end(), stage) != state.stage().end();
  };
  if (rule.has_phase() && rule.phase() != state.phase()) return false;
  if (rule.has_min_level() && state.level() < rule.min_level()) return false;
  if (rule.has_max_level() && state.level() > rule.max_level()) return false;
  return std::all_of(rule.stage().begin(), rule.stage().end(), has_stage) &&
         std::none_of(rule.not_stage().begin(), rule.not_stage().end(), has_stage);
}

bool included(const caffe::NetState& state, const caffe::LayerParameter& layer) {
  const auto met = [&](const caffe::NetStateRule& rule) { return meets(state, rule); };
  if (layer.include_size() > 0 && layer.exclude_size() > 0) return true;  // an error if needed
  if (layer.include_size() > 0)
    return std::any_of(layer.include().begin(), layer.include().end(), met);
  return std::none_of(layer.exclude().begin(), layer.exclude().end(), met);
}

/// Stages are those of the net and of `given`; phase and level are those of `given`, as in pycaffe.
/// A data layer of another phase stays if its blobs have no other writer. `dropped`: see NetFile.
void keep_state(caffe::NetParameter& net, const NetReadOptions& given, const Blame& blame,
                std::vector<std::string>& warnings, std::map<std::string, std::string>& dropped) {
  for (Layer& layer : *net.mutable_layer())
    if (layer.include_size() > 0 && layer.exclude_size() > 0)
      blame(layer, "give include or exclude rules, not both", -1);
  caffe::NetState state = net.state();
  state.set_phase(given.train ? caffe::TRAIN : caffe::TEST);
  state.set_level(given.level);
  for (const std::string& stage : given.stages) state.add_stage(stage);
  std::set<std::string> written, read;
  for (const Layer& layer : net.layer()) {
    if (!included(state, layer)) continue;
    written.insert(layer.top().begin(), layer.top().end());
    read.insert(layer.bottom().begin(), layer.bottom().end());
  }
  const auto state_name = given.train ? "TRAIN" : "TEST";
  const auto drops = [&](const Layer& layer) {
    if (included(state, layer)) return false;
    bool is_missed = false, is_first = true;
    for (const std::string& top : layer.top()) {
      if (written.contains(top)) is_first = false;
      if (written.contains(top) || !read.contains(top)) continue;
      is_missed = true;
      dropped.emplace(top,
                      str("layer '", layer.name(), "' (", layer.type(), ") writes it, but its ",
                          "include and exclude rules drop it in phase ", state_name));
    }
    if (!is_missed || !is_first || !reads_data(layer, given.keep_python)) return true;
    written.insert(layer.top().begin(), layer.top().end());
    warnings.push_back(str("layer '", layer.name(), "' (", layer.type(), ") is kept, although its ",
                           "rules drop it in phase ", state_name,
                           ", because no other layer writes '", layer.top(0), "'"));
    return false;
  };
  auto& layers = *net.mutable_layer();
  layers.erase(std::remove_if(layers.begin(), layers.end(), drops), layers.end());
}

/// Returns {} if the file lacks the shape.
std::vector<int64_t> image_shape(const Layer& layer, std::string& reason) {
  const auto& transform = layer.transform_param();
  const int64_t crop = transform.crop_size();
  int64_t batch = 0, height = crop, width = crop, channels = transform.force_gray() ? 1 : 3;
  if (layer.type() == "MemoryData") {
    const auto& memory = layer.memory_data_param();
    batch = memory.batch_size(), channels = memory.channels();
    height = memory.height(), width = memory.width();
    reason = "from its memory_data_param";
  } else {
    reason = str("its batch_size and crop_size, ", channels,
                 channels == 1 ? " channel" : " channels", " assumed");
    if (layer.type() == "Data" || layer.type() == "AnnotatedData")
      batch = layer.data_param().batch_size();
    if (layer.type() == "WindowData") batch = layer.window_data_param().batch_size();
    if (layer.type() == "ImageData") {
      const auto& image = layer.image_data_param();
      batch = image.batch_size();
      channels = image.is_color() ? 3 : 1;
      reason = "its batch_size and crop_size";
      if (crop == 0) {
        height = image.new_height(), width = image.new_width();
        reason = "its batch_size, new_height and new_width";
      }
    }
  }
  if (crop == 0 && transform.has_resize_param()) {
    height = transform.resize_param().height(), width = transform.resize_param().width();
    reason = str("its batch_size and resize_param, ", channels, " channels assumed");
  }
  std::vector<int64_t> shape = {batch, channels, height, width};
  if (std::ranges::any_of(shape, [](int64_t size) { return size < 1; })) return {};
  return shape;
}

std::string preprocessing(const caffe::TransformationParameter& transform) {
  std::string done;
  const auto add = [&](const std::string& what) { done += (done.empty() ? "" : ", ") + what; };
  if (transform.has_mean_file()) add(str("mean_file '", transform.mean_file(), "'"));
  for (const float value : transform.mean_value()) add(str("mean_value ", value));
  if (transform.has_scale() && transform.scale() != 1) add(str("scale ", transform.scale()));
  return done;
}

class Extraction {
 public:
  Extraction(caffe::NetParameter& net, const NetReadOptions& options,
             std::vector<std::string>& warnings)
      : net_(net), options_(options), warnings_(warnings), n_(net.layer_size()) {}

  std::map<std::string, std::string> run() {
    find_makers();
    find_training_layers();
    find_label_layers();
    choose_softmax();
    build();
    return std::move(became_);
  }

 private:
  struct Maker {
    int layer = -1, top = 0;
  };
  struct Use {
    int layer, bottom;
  };

  const Layer& layer(int i) const { return net_.layer(i); }
  bool is_data(int i) const { return reads_data(layer(i), options_.keep_python); }

  void find_makers() {
    const Graph graph = resolve(net_);
    std::vector<Maker> makers(graph.values.size());
    makers_.resize(n_);
    uses_.resize(n_);
    learned_.resize(n_);
    for (const Node& node : graph.nodes) {
      if (node.index < 0) {  // the blob of its second input
        makers[node.outputs[0]] = makers[node.inputs[1]];
        continue;
      }
      const int i = node.index;
      learned_[i] = options_.types_with_weights.contains(node.type);
      for (int b = 0; b < layer(i).bottom_size(); ++b) {
        const Maker maker = node.inputs[b] < 0 ? Maker{} : makers[node.inputs[b]];
        makers_[i].push_back(maker);
        if (maker.layer < 0) continue;
        uses_[maker.layer][maker.top].push_back({i, b});
        if (learned_[maker.layer]) learned_[i] = true;
      }
      uses_[i].resize(layer(i).top_size());
      for (int t = 0; t < layer(i).top_size(); ++t) makers[node.outputs[t]] = {i, t};
    }
  }

  void find_training_layers() {
    training_.resize(n_);
    for (int i = 0; i < n_; ++i) {
      training_[i] = kTrainingTypes.contains(layer(i).type());
      for (const Maker& maker : makers_[i])
        // The second top of SoftmaxWithLoss is the prediction.
        if (maker.layer >= 0 && training_[maker.layer] &&
            !(layer(maker.layer).type() == "SoftmaxWithLoss" && maker.top == 1))
          training_[i] = true;
    }
  }

  bool is_label(const Use& use) const {
    const auto learned = [&](const Maker& maker) {
      return maker.layer >= 0 && learned_[maker.layer];
    };
    const std::vector<Maker>& makers = makers_[use.layer];
    if (std::ranges::any_of(makers, learned) || layer(use.layer).type() == "Silence")
      return !learned(makers[use.bottom]);
    return use.bottom > 0;
  }

  bool serves_training(const Use& use) const {
    return labels_[use.layer] || (training_[use.layer] && is_label(use));
  }

  /// Iterates backward, because users follow makers.
  void find_label_layers() {
    labels_.assign(n_, false);
    for (int i = n_; i-- > 0;) {
      if (training_[i] || is_data(i)) continue;
      bool used = false, only_labels = true;
      for (const std::vector<Use>& uses : uses_[i])
        for (const Use& use : uses) {
          used = true;
          only_labels &= serves_training(use);
        }
      labels_[i] = used && only_labels;
    }
  }

  std::vector<int> needed_tops(int i) const {
    std::vector<int> tops;
    for (int t = 0; t < layer(i).top_size(); ++t)
      if (!std::ranges::all_of(uses_[i][t], [&](const Use& use) { return serves_training(use); }))
        tops.push_back(t);
    return tops;
  }

  /// Selects the SoftmaxWithLoss layers that become a Softmax: those with a second top, or the only
  /// one if the prediction has no other Softmax.
  void choose_softmax() {
    std::vector<int> losses;
    for (int i = 0; i < n_; ++i)
      if (layer(i).type() == "SoftmaxWithLoss" && layer(i).bottom_size() > 0) losses.push_back(i);
    for (const int i : losses) {
      const Maker maker = makers_[i][0];
      const bool has_softmax =
          maker.layer >= 0 &&
          std::ranges::any_of(uses_[maker.layer][maker.top],
                              [&](const Use& use) { return layer(use.layer).type() == "Softmax"; });
      if (layer(i).top_size() > 1 || (losses.size() == 1 && !has_softmax)) softmax_.insert(i);
    }
  }

  bool is_taken(const std::string& name) const {
    return std::ranges::any_of(net_.layer(), [&](const Layer& other) {
      return other.name() == name || std::ranges::find(other.top(), name) != other.top().end();
    });
  }

  void build() {
    for (int i = 0; i < n_; ++i)
      if (is_data(i))
        add_inputs(i);
      else if (softmax_.contains(i))
        add_softmax(i);
      else if (layer(i).type() == "Silence")
        add_silence(i);
      else if (training_[i] || labels_[i])
        skipped_.push_back(i);
      else
        *kept_.add_layer() = layer(i);
    const auto name = [&](int i) { return str("'", layer(i).name(), "' (", layer(i).type(), ")"); };
    if (!skipped_.empty())
      warnings_.push_back(str("skipped, for training only: ", joined(skipped_, ", ", name)));
    for (const int i : skipped_) became_[layer(i).name()] = "it is for training only";
    net_.mutable_layer()->Swap(kept_.mutable_layer());
  }

  /// Adds one Input layer per top, because an Input layer has shapes for all its tops or none.
  void add_inputs(int i) {
    const std::vector<int> tops = needed_tops(i);
    if (tops.empty()) skipped_.push_back(i);
    for (const int top : tops) {
      const std::string& blob = layer(i).top(top);
      Layer& input = *kept_.add_layer();
      input.set_name(tops.size() == 1 ? layer(i).name() : blob);
      input.set_type("Input");
      input.add_top(blob);
      warnings_.push_back(str("layer '", layer(i).name(), "' (", layer(i).type(),
                              ") is now the input '", blob, "', ", set_shape(i, top, input)));
    }
  }

  /// Returns text for a warning.
  std::string set_shape(int i, int top, Layer& input) const {
    std::string reason;
    std::vector<int64_t> shape;
    const auto& given = layer(i).input_param().shape();
    if (!given.empty()) {
      const auto& dims = given[std::min(top, given.size() - 1)].dim();
      shape.assign(dims.begin(), dims.end());
      reason = "from its input_param";
    } else if (layer(i).type() != "HDF5Data") {
      shape = image_shape(layer(i), reason);
    }
    if (top == 1 && !shape.empty() && given.size() < 2) {
      shape = {shape[0]};
      reason = "one label per image";
    }
    if (!shape.empty()) {
      auto& dims = *input.mutable_input_param()->add_shape()->mutable_dim();
      dims.Add(shape.begin(), shape.end());
    }
    const std::string lost = top == 1 ? "" : preprocessing(layer(i).transform_param());
    return str(shape.empty() ? "of unknown shape" : str(shape_text(shape), " (", reason, ")"),
               lost.empty() ? "" : "; the caller must apply its preprocessing: " + lost);
  }

  void add_softmax(int i) {
    const Layer& loss = layer(i);
    Layer& softmax = *kept_.add_layer();
    const std::string name = is_taken("prob") ? loss.name() : "prob";
    softmax.set_name(name);
    softmax.set_type("Softmax");
    became_[loss.name()] = str("it is now '", name, "'");
    softmax.add_bottom(loss.bottom(0));
    softmax.add_top(loss.top_size() > 1 ? loss.top(1) : name);
    copy_marks(loss, softmax);
    if (loss.has_softmax_param()) *softmax.mutable_softmax_param() = loss.softmax_param();
    warnings_.push_back(str("layer '", loss.name(), "' (SoftmaxWithLoss) is now '", name,
                            "' (Softmax) of '", loss.bottom(0), "'"));
  }

  /// Keeps a Silence for unused outputs; drops it if it only hides labels.
  void add_silence(int i) {
    Layer silence = layer(i);
    silence.clear_bottom();
    for (int b = 0; b < layer(i).bottom_size(); ++b)
      if (!is_label({i, b})) silence.add_bottom(layer(i).bottom(b));
    if (silence.bottom_size() > 0)
      *kept_.add_layer() = std::move(silence);
    else
      skipped_.push_back(i);
  }

  caffe::NetParameter& net_;
  const NetReadOptions& options_;
  std::vector<std::string>& warnings_;
  const int n_;
  std::vector<std::vector<Maker>> makers_;           // [layer][bottom]
  std::vector<std::vector<std::vector<Use>>> uses_;  // [layer][top]
  std::vector<bool> learned_, training_, labels_;    // [layer]
  std::set<int> softmax_;
  std::vector<int> skipped_;
  std::map<std::string, std::string> became_;  // fate of layers, by name
  caffe::NetParameter kept_;
};

}  // namespace

void keep_inference(NetFile& file, const NetReadOptions& options, const Blame& blame,
                    std::vector<std::string>& warnings) {
  caffe::NetParameter& net = file.net;
  keep_state(net, options, blame, warnings, file.dropped);
  const bool has_data = std::ranges::any_of(
      net.layer(), [&](const Layer& layer) { return reads_data(layer, options.keep_python); });
  if (has_data) file.skipped = Extraction(net, options, warnings).run();
}

}  // namespace revisit::proto
