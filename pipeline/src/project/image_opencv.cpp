// All of OpenCV that the range image needs: hole closing and PNG.
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include "revisit/pipeline/range_image.h"
#include "revisit/proto/atomic_file.h"
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

void write_png(const std::string& file, const RangeImage& image) {
  cv::Mat grey;
  view_of(image).convertTo(grey, CV_8U);  // rounds and saturates
  std::vector<unsigned char> png;
  if (grey.empty() || !cv::imencode(".png", grey, png))
    throw Error(str(file, ": cannot encode ", image.width, " x ", image.height, " pixels as PNG"));
  write_atomically(file, [&](std::ostream& out) {
    out.write(reinterpret_cast<const char*>(png.data()), static_cast<std::streamsize>(png.size()));
  });
}

}  // namespace revisit::pipeline
