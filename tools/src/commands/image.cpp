#include <algorithm>
#include <cmath>
#include <numbers>

#include "cli/command.h"
#include "cli/geometry_options.h"
#include "cli/json.h"
#include "cli/options.h"
#include "cli/table.h"
#include "eval/feature_options.h"
#include "reports.pb.h"
#include "revisit/base/error.h"
#include "revisit/base/files.h"
#include "revisit/datasets/scan_file.h"
#include "revisit/recognition/align.h"
#include "revisit/recognition/range_image.h"

namespace revisit::cli {
namespace {

namespace fs = std::filesystem;

constexpr const char* kImageSummary =
    "Writes the range image that is the input of a network as PNG, before hole closing "
    "(NAME_projected.png) and after "
    "(NAME_closed.png), and prints the alignment of the scan. SCAN is a .bin (KITTI), .pcd or .ply "
    "file.";
constexpr const char* kImageExamples =
    "  revisit image sequences/00/velodyne/000052.bin -o images\n"
    "  revisit image scan.pcd --sensor vlp16 --align none\n"
    "  revisit image scan.bin --gamma 2.5                 # brighter, for viewing\n"
    "  revisit image scan.bin --width 2000 --max-range 50 --format json\n";

struct ImageOptions {
  fs::path scan, output = ".";
  std::string align = "case1", format = "table";
  double gamma = 1;
  GeometryOptions image;

  void declare(Options& options);
};

void ImageOptions::declare(Options& options) {
  options.argument("SCAN", &scan)
      .option("output", "DIR", "folder of the PNG files (default: the working directory)", &output,
              'o')
      .choice("align", {"case1", "case2", "none"}, "alignment of the scan (default case1)", &align)
      .option("gamma", "G",
              "gamma correction of the PNG files for viewing, 255 (v / 255)^(1 / G); the network's "
              "input has G = 1 "
              "(default 1)",
              &gamma)
      .positive()
      .choice("format", {"table", "json"}, "format of standard output (default table)", &format);
  image.declare(options);
}

Alignment align_scan(const PointCloud& cloud, const ImageOptions& o) {
  try {
    return principal_alignment(cloud, o.align == "case2" ? AlignCase::kTwo : AlignCase::kOne);
  } catch (const InputError& error) {
    throw InputError(o.scan.string(), ": ", error.what());
  }
}

void report_alignment(const Alignment& alignment, reports::RangeImageSummary* summary) {
  summary->set_yaw_deg(double{alignment.yaw} * 180 / std::numbers::pi);
  summary->set_eigenvalue_ratio(alignment.eigenvalue_ratio);
  summary->set_abs_t11(alignment.abs_t11);
  // Principal directions of nearby scans differ by some degrees, which can flip a small |t11|.
  constexpr float kRoundCloud = 1.1F, kNearSignChange = 0.1F;
  if (alignment.eigenvalue_ratio < kRoundCloud)
    summary->add_warnings("eigenvalue ratio near 1: the principal direction is not determined");
  if (alignment.abs_t11 < kNearSignChange)
    summary->add_warnings("|t11| near 0: the direction may flip by 180 degrees");
  if (alignment.mirrored_choice)
    summary->add_warnings("t22 < 0: the paper's case 1 would need a mirror image");
}

/// Brightens an image for viewing, because most ranges are a small fraction of the largest.
RangeImage brightened(RangeImage image, double gamma) {
  for (float& pixel : image.pixels)
    pixel = static_cast<float>(255 * std::pow(double{pixel} / 255, 1 / gamma));
  return image;
}

double filled(const RangeImage& image) {
  const auto empty = std::count(image.pixels.begin(), image.pixels.end(), 0.0F);
  return 1 - static_cast<double>(empty) / static_cast<double>(image.pixels.size());
}

Table table_of(const reports::RangeImageSummary& s) {
  const auto percent = [](double fraction) { return number(100 * fraction, 1) + " %"; };
  Table table({"scan", s.scan()});
  table.row({"image", str(s.width(), " x ", s.height(), ", ", s.sensor())});
  if (!s.sensor_found().empty()) table.row({"sensor", s.sensor_found()});
  table.row({"points", str(s.points())});
  table.row({"usable points", str(s.usable_points())});
  table.row({"outside", percent(s.points_outside())});
  table.row({"pixels hit", percent(s.pixels_hit())});
  table.row({"after closing", percent(s.pixels_closed())});
  table.row({"alignment", s.align()});
  if (s.has_yaw_deg()) {
    table.row({"yaw [deg]", number(s.yaw_deg(), 2)});
    table.row({"eigenvalue ratio", number(s.eigenvalue_ratio(), 2)});
    table.row({"|t11|", number(s.abs_t11(), 3)});
  }
  for (const std::string& warning : s.warnings()) table.row({"warning", warning});
  table.row({"projected", s.projected_png()});
  table.row({"closed", s.closed_png()});
  return table;
}

int write_images(ImageOptions& o) {
  reports::RangeImageSummary summary;

  const PointCloud cloud = read_scan(o.scan);
  summary.set_sensor_found(o.image.resolve({cloud}));
  const ImageGeometry geometry = o.image.geometry();
  summary.set_points(static_cast<int>(cloud.points.size()));
  summary.set_usable_points(
      static_cast<int>(std::count_if(cloud.points.begin(), cloud.points.end(), is_return)));
  Eigen::Matrix3f R_image_sensor = Eigen::Matrix3f::Identity();
  if (o.align != "none") {
    const Alignment alignment = align_scan(cloud, o);
    report_alignment(alignment, &summary);
    R_image_sensor = alignment.R_aligned_sensor;
  }
  RangeImage projected;
  const double outside =
      project_rotated(cloud, R_image_sensor, geometry, projected).outside_share();
  summary.set_points_outside(outside);
  if (outside > kManyOutside) summary.add_warnings(points_outside(outside, geometry, cloud));
  const RangeImage closed = close_holes(projected, geometry);

  make_folder(o.output);
  const std::string stem = (o.output / o.scan.stem()).string();
  write_png(stem + "_projected.png", brightened(projected, o.gamma));
  write_png(stem + "_closed.png", brightened(closed, o.gamma));

  summary.set_scan(o.scan.string());
  summary.set_sensor(o.image.sensor);
  summary.set_align(o.align);
  summary.set_width(geometry.width);
  summary.set_height(geometry.height);
  summary.set_pixels_hit(filled(projected));
  summary.set_pixels_closed(filled(closed));
  summary.set_projected_png(stem + "_projected.png");
  summary.set_closed_png(stem + "_closed.png");
  print_report(o.format, summary, table_of(summary));
  return kOk;
}

}  // namespace

Command image_command() {
  return {"image", "write the range image of a scan as PNG", kImageSummary, kImageExamples,
          with_options<ImageOptions>(write_images)};
}

}  // namespace revisit::cli
