#pragma once

#if __has_include(<opencv2/imgproc.hpp>)

#include <algorithm>
#include <filesystem>
#include <map>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "revisit/engine/net.h"

/// Caffe networks for programs that called cv::dnn, whose importer OpenCV 5 lacks. Needs OpenCV's
/// headers and its libraries core and imgproc; this library itself does not link them.
namespace revisit::dnn {

/// Network in place of cv::dnn::Net, for float32 blobs `[n][c][h][w]` of any shape that the layers
/// accept. Outputs are known by names of layers. Use one per thread; it cannot be copied.
class Net {
 public:
  /// Throws InputError, UnsupportedError as engine::Net::load().
  Net(const std::filesystem::path& prototxt, const std::filesystem::path& caffemodel,
      int threads = 1)
      : net_(engine::Net::load(prototxt, caffemodel, {.allow_unknown = true})), threads_(threads) {}
  /// Takes a net that was loaded otherwise, e.g. from memory.
  explicit Net(engine::Net net, int threads = 1) : net_(std::move(net)), threads_(threads) {}

  /// Sets an input by its blob name; "": the first. Other types than CV_32F are converted. Throws
  /// UsageError for an unknown name.
  void set_input(const cv::Mat& blob, const std::string& name = "") {
    const auto& inputs = net_.inputs();
    const auto input =
        name.empty() ? inputs.begin() : std::ranges::find(inputs, name, &engine::Port::name);
    if (input == inputs.end()) throw UsageError("set_input: the net has no input '", name, "'");
    cv::Mat values;
    blob.convertTo(values, CV_MAKETYPE(CV_32F, blob.channels()));
    inputs_[input->name] = values;
  }

  /// Runs the layers that a layer needs and returns its first output; "": the last layer. Throws
  /// UsageError for an unknown layer or an input without values, InputError for unsuitable shapes.
  cv::Mat forward(const std::string& layer = "") {
    return forward_all({layer.empty() ? net_.layer_names().back() : layer}).front();
  }
  /// Runs the layers that several layers need and returns their first outputs; throws likewise.
  std::vector<cv::Mat> forward_all(const std::vector<std::string>& layers) {
    const engine::Run& done = pass(layers);
    std::vector<cv::Mat> outputs;
    for (const std::string& layer : layers) {
      const engine::View<const float> output = done.output(layer);
      const std::vector<int> sizes(output.shape.axes().begin(), output.shape.axes().end());
      outputs.emplace_back(static_cast<int>(sizes.size()), sizes.data(), CV_32F);
      std::ranges::copy(output.values(), outputs.back().ptr<float>());
    }
    return outputs;
  }

  /// Layers, inputs, weights, costs.
  const engine::Net& net() const { return net_; }

 private:
  static std::vector<int64_t> axes_of(const cv::Mat& blob) {
    std::vector<int64_t> axes(blob.size.p, blob.size.p + blob.dims);
    if (blob.channels() > 1) axes.push_back(blob.channels());
    return axes;
  }

  const engine::Run& pass(const std::vector<std::string>& layers) {
    std::map<std::string, engine::Shape> shapes;
    for (const engine::Port& input : net_.inputs()) {
      if (!inputs_.contains(input.name))
        throw UsageError("forward: no values for the input '", input.name, "'; call set_input()");
      shapes.emplace(input.name, engine::Shape(axes_of(inputs_.at(input.name))));
    }
    if (!run_ || layers != layers_ || shapes != shapes_) {
      run_.emplace(net_.truncated(layers).plan(shapes, {.threads = threads_}));
      layers_ = layers;
      shapes_ = shapes;
    }
    for (const auto& [name, blob] : inputs_)
      std::copy_n(blob.ptr<float>(), blob.total() * static_cast<size_t>(blob.channels()),
                  run_->input(name).data);
    run_->forward();
    return *run_;
  }

  engine::Net net_;
  int threads_;
  std::map<std::string, cv::Mat> inputs_;
  std::optional<engine::Run> run_;  // of these layers and shapes
  std::vector<std::string> layers_;
  std::map<std::string, engine::Shape> shapes_;
};

/// Returns (image - mean) * scale as a blob `[1][c][h][w]` of float32, with the values of
/// cv::dnn::blobFromImage(). `size`: empty for the image's. `mean`: of the channels of the blob.
/// `crop`: keeps the aspect ratio and cuts what exceeds the size.
inline cv::Mat blob_from_image(cv::Mat image, double scale = 1, cv::Size size = {},
                               const cv::Scalar& mean = {}, bool swap_rb = false,
                               bool crop = false) {
  if (image.empty()) throw UsageError("blob_from_image: the image is empty, e.g. not read");
  if (!size.empty() && size != image.size()) {
    if (crop) {
      const double factor = std::max(static_cast<double>(size.width) / image.cols,
                                     static_cast<double>(size.height) / image.rows);
      cv::resize(image, image, {}, factor, factor);
      image =
          image(cv::Rect({(image.cols - size.width) / 2, (image.rows - size.height) / 2}, size));
    } else {
      cv::resize(image, image, size);
    }
  }
  const int n = image.channels(), sizes[] = {1, n, image.rows, image.cols};
  cv::Mat blob(4, sizes, CV_32F);
  std::vector<cv::Mat> channels;
  cv::split(image, channels);
  if (swap_rb && n > 2) std::swap(channels[0], channels[2]);
  for (int c = 0; c < n; ++c) {
    cv::Mat plane(image.rows, image.cols, CV_32F, blob.ptr<float>(0, c));
    channels[static_cast<size_t>(c)].convertTo(plane, CV_32F);
    plane -= c < 4 ? mean[c] : 0;
    plane *= scale;
  }
  return blob;
}

}  // namespace revisit::dnn

#endif
