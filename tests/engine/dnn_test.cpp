#include "revisit/engine/dnn.h"

#include "testing.h"

#if __has_include(<opencv2/imgproc.hpp>)

namespace revisit::dnn {
namespace {

/// 2 x + 1, then the sum of 2 x 2 blocks.
constexpr const char* kNet = R"(
layer { name: "in" type: "Input" top: "data" input_param { shape { dim: 1 dim: 3 dim: 2 dim: 2 } } }
layer { name: "double" type: "Power" bottom: "data" top: "x" power_param { scale: 2 shift: 1 } }
layer { name: "relu" type: "ReLU" bottom: "x" top: "x" }
layer { name: "mean" type: "Pooling" bottom: "x" top: "y"
        pooling_param { pool: AVE kernel_size: 2 stride: 2 } }
)";

Net small() {
  return Net(engine::Net::load_from_memory(kNet, "\n\1n\242\6\3\n\1n"));
}

TEST(Dnn, RunsTheLayersOfAnOutput) {
  Net net = small();
  net.set_input(blob_from_image(cv::Mat(4, 6, CV_8UC3, cv::Scalar(1, 2, 3)), 1, {}, {3, 0, 0}));
  const std::vector<cv::Mat> outputs = net.forward_all({"double", "mean"});
  EXPECT_EQ(outputs[0].size[3], 6);
  EXPECT_EQ(outputs[0].ptr<float>(0, 0)[0], -3);
  EXPECT_EQ(outputs[1].ptr<float>(0, 0)[0], 0);
  EXPECT_EQ(net.forward().ptr<float>(0, 2)[5], 7);
  net.set_input(cv::Mat(2, 2, CV_32F, cv::Scalar(5)).reshape(1, {1, 1, 2, 2}), "data");
  EXPECT_EQ(net.forward().ptr<float>()[0], 11);
  expect_error<UsageError>([&] { net.set_input(cv::Mat(), "date"); }, {"no input 'date'"});
  expect_error<UsageError>([&] { net.forward("means"); }, {"no layer 'means'", "did you mean"});
  expect_error<UsageError>([] { small().forward(); }, {"no values for the input 'data'"});
}

TEST(Dnn, BlobsAreThoseOfOpenCv) {
  cv::Mat image(2, 4, CV_8UC3);
  for (int i = 0; i < 24; ++i) image.data[i] = static_cast<uint8_t>(i * 10);
  // cv2.dnn.blobFromImage(image, 0.5, (2, 2), (1, 2, 3), True, crop) of OpenCV 4.14
  const cv::Mat cropped = blob_from_image(image, 0.5, {2, 2}, {1, 2, 3}, true, true);
  EXPECT_EQ(std::vector<float>(cropped.ptr<float>(), cropped.ptr<float>() + 12),
            (std::vector<float>{24.5, 39.5, 84.5, 99.5, 19, 34, 79, 94, 13.5, 28.5, 73.5, 88.5}));
  const cv::Mat whole = blob_from_image(image, 0.5, {2, 2}, {1, 2, 3}, true);
  EXPECT_EQ(std::vector<float>(whole.ptr<float>(), whole.ptr<float>() + 4),
            (std::vector<float>{17, 47, 77, 107}));
  expect_error<UsageError>([] { blob_from_image({}); }, {"the image is empty"});
}

}  // namespace
}  // namespace revisit::dnn

#endif
