#include <algorithm>
#include <optional>

#include "check.h"
#include "layers/layers.h"
#include "revisit/base/error.h"

namespace revisit::random_nets {
namespace {

/// Layer `at` is in-place or has unused outputs.
std::optional<RandomNet> without(const RandomNet& net, int at) {
  RandomNet result = net;
  result.net.mutable_layer()->DeleteSubrange(at, 1);
  return result;
}

std::optional<RandomNet> with_input(const RandomNet& net, int at) {
  const caffe::LayerParameter& layer = net.net.layer(at);
  if (layer.type() == "Input" || layer.top_size() != 1) return std::nullopt;
  RandomNet result = net;
  std::map<std::string, engine::Shape> blobs;
  const InputShapes given = input_shapes(net, net.sizes[0]);
  for (int i = 0; i <= at; ++i) {
    const caffe::LayerParameter& before = net.net.layer(i);
    std::vector<engine::Shape> inputs;
    for (const std::string& bottom : before.bottom()) inputs.push_back(blobs.at(bottom));
    if (before.type() == "Input") {
      blobs[before.top(0)] = given.shapes.at(before.top(0));
      continue;
    }
    const auto outputs =
        engine::make_layer(before)->infer(inputs, static_cast<size_t>(before.top_size()));
    for (size_t port = 0; port < outputs.size(); ++port)
      blobs[before.top(static_cast<int>(port))] = outputs[port];
  }
  caffe::LayerParameter& input = *result.net.mutable_layer(at);
  const std::string blob = layer.top(0);
  input.Clear();
  input.set_name(layer.name());
  input.set_type("Input");
  input.add_top(blob);
  input.mutable_input_param()->add_shape();
  Input& what = result.inputs[blob] = {};
  for (const int64_t size : blobs.at(blob).axes()) {
    input.mutable_input_param()->mutable_shape(0)->add_dim(size);
    what.axes.push_back({size});
  }
  result.channel_offsets.clear();
  return result;
}

std::string kind(const std::string& fault) {
  return fault.find("off by") != std::string::npos    ? "numbers"
         : fault.find("threads") != std::string::npos ? "threads"
                                                      : "other";
}

std::string fault_of(const RandomNet& net) {
  try {
    Statistics ignored;
    return find_fault(net, ignored);
  } catch (const std::exception&) {
    return "";
  }
}

}  // namespace

Shrunk shrink(const RandomNet& net, const std::string& fault) {
  Shrunk best{net, fault};
  for (bool smaller = true; smaller;) {
    smaller = false;
    for (int at = best.net.net.layer_size(); at-- > 0;)
      for (const auto& change : {without, with_input}) {
        if (at >= best.net.net.layer_size()) break;
        try {
          const std::optional<RandomNet> candidate = change(best.net, at);
          if (!candidate) continue;
          const std::string found = fault_of(*candidate);
          if (found.empty() || kind(found) != kind(fault)) continue;
          best = {*candidate, found};
          smaller = true;
          break;
        } catch (const std::exception&) {
        }
      }
  }
  return best;
}

std::string describe(const RandomNet& net, const std::string& fault) {
  const Shrunk small = shrink(net, fault);
  std::string text = str("seed ", net.seed, ": ", fault, "\n--- shrunk: ", small.fault, "\n");
  if (!net.end.empty())
    text += str("--- cut off at ", net.end, net.graft.empty() ? "" : "+" + net.graft, "\n");
  for (const std::vector<int64_t>& sizes : small.net.sizes) {
    text += "--- inputs:";
    try {
      for (const auto& [blob, shape] : input_shapes(small.net, sizes).shapes)
        text += str(" ", blob, "=", shape);
    } catch (const Error& error) {
      text += error.what();
    }
    text += "\n";
  }
  for (const float offset : small.net.channel_offsets)
    text += str("--- gray offset ", offset, "\n");
  return text + text_of(small.net);
}

}  // namespace revisit::random_nets
