#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include "revisit/pipeline/range_image.h"
#include "revisit/proto/error.h"

namespace revisit::pipeline {
namespace {

/// The pixels seen by OpenCV, not copied. It has no view of constant data: do not write to it.
cv::Mat view_of(const RangeImage& image) {
  return {image.height, image.width, CV_32F, const_cast<float*>(image.pixels.data())};
}

}  // namespace

RangeImage close_holes(const RangeImage& image, const ImageGeometry& geometry) {
  check_geometry(geometry);
  const cv::Size rectangle(geometry.closing_width, geometry.closing_height);
  if (rectangle.width > image.width || rectangle.height > image.height)
    throw UsageError(str("hole closing: a rectangle of ", rectangle.width, " x ", rectangle.height,
                         " is larger than the image, ", image.width, " x ", image.height));
  if (rectangle.area() == 1) return image;

  // Around the edge: as many columns of the other side as both operations together look at.
  const int pad = rectangle.width - 1;
  cv::Mat padded;
  cv::copyMakeBorder(view_of(image), padded, 0, 0, pad, pad, cv::BORDER_WRAP);
  // OpenCV's default border value is neutral for both: beyond the top and bottom nothing counts.
  cv::Mat dilated, closed;
  const cv::Mat kernel = cv::getStructuringElement(cv::MORPH_RECT, rectangle);
  cv::dilate(padded, dilated, kernel);
  cv::erode(dilated, closed, kernel);

  RangeImage result{image.width, image.height, std::vector<float>(image.pixels.size())};
  cv::Mat target = view_of(result);
  closed.colRange(pad, pad + image.width).copyTo(target);
  return result;
}

}  // namespace revisit::pipeline
