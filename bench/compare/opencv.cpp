#include <opencv2/core.hpp>
#include <opencv2/dnn.hpp>

#include "subject.h"

namespace revisit::bench {
namespace {

class OpenCv : public Subject {
 public:
  OpenCv(const Model& model, const Setting& setting, std::span<const float> input)
      : input_name_(model.input_name), output_name_(model.layers.back().param.name()) {
    cv::setNumThreads(setting.threads);
    net_ = cv::dnn::readNetFromCaffe(model.prototxt.string(), model.weights.string());
    net_.setPreferableBackend(cv::dnn::DNN_BACKEND_OPENCV);
    net_.setPreferableTarget(cv::dnn::DNN_TARGET_CPU);
    const std::vector<int> sizes(model.input().axes().begin(), model.input().axes().end());
    input_.create(sizes, CV_32F);
    std::copy(input.begin(), input.end(), input_.ptr<float>());
  }

  std::string name() const override { return std::string("OpenCV dnn ") + CV_VERSION; }
  void forward() override {
    net_.setInput(input_, input_name_);
    output_ = net_.forward(output_name_);
  }
  /// OpenCV measures each layer in ticks.
  std::vector<double> timed_forward() override {
    forward();
    std::vector<double> times;
    net_.getPerfProfile(times);
    for (double& time : times) time *= 1000 / cv::getTickFrequency();
    return times;
  }
  std::span<const float> output() const override { return {output_.ptr<float>(), output_.total()}; }

 private:
  std::string input_name_, output_name_;
  cv::dnn::Net net_;
  cv::Mat input_, output_;
};

}  // namespace

std::unique_ptr<Subject> make_opencv(const Model& model, const Setting& setting,
                                     std::span<const float> input) {
  return std::make_unique<OpenCv>(model, setting, input);
}

}  // namespace revisit::bench
