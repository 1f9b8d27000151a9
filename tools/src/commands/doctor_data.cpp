#include "commands/doctor_data.h"

#include <algorithm>
#include <cmath>
#include <iomanip>
#include <iostream>
#include <numbers>

#include "cli/table.h"
#include "eval/feature_options.h"
#include "loops/recording.h"
#include "revisit/base/error.h"
#include "revisit/base/files.h"
#include "revisit/base/text.h"
#include "revisit/datasets/dataset.h"
#include "revisit/datasets/scan_file.h"
#include "revisit/recognition/align.h"
#include "revisit/recognition/range_image.h"

namespace revisit::cli {
namespace {

namespace fs = std::filesystem;

std::string plural(int64_t count, const char* what) {
  return str(count, " ", what, count == 1 ? "" : "s");
}

/// "7 places with 77 scans", or "12 scans, 4541 poses, no times".
std::string content_of(const Dataset& data) {
  const std::string scans = plural(static_cast<int64_t>(data.scans.size()), "scan");
  if (data.has_places()) {
    int64_t places = 0;
    for (size_t i = 0; i < data.scans.size(); ++i)
      places += i == 0 || data.scans[i].place != data.scans[i - 1].place;
    return plural(places, "place") + " with " + scans;
  }
  return str(scans, ", ", data.n_poses ? plural(data.n_poses, "pose") : "no poses", ", ",
             data.scans[0].time ? "times" : "no times");
}

/// Throws InputError if there is no such data.
void print_sequence(const fs::path& root, const std::string& sequence) {
  const Dataset data = open_dataset(root, sequence);
  std::string found = content_of(data);
  std::vector<std::string> advice = data.warnings;
  const auto empty = std::ranges::count_if(data.scans, [](const ScanRef& scan) {
    std::error_code error;
    return fs::file_size(scan.file, error) == 0 && !error;
  });
  if (empty > 0) advice.push_back(plural(empty, "scan file") + " empty; copy the data set again");
  const bool is_drive = !data.has_places() && !data.sequence.empty();
  if (is_drive && !data.has_poses())
    advice.emplace_back("no ground truth, so evaluation is not possible");
  const fs::path images = data.scans[0].file.parent_path().parent_path() / "image_0";
  if (is_drive && fs::is_directory(images)) try {
      found += ", " + plural(static_cast<int64_t>(camera_images(data).scans.size()), "image");
    } catch (const InputError& error) {
      advice.emplace_back(error.what());
    }
  print_finding(
      data.sequence.empty() ? "scans" : (data.has_places() ? "set " : "sequence ") + data.sequence,
      found, joined(advice, "; "));
}

std::vector<std::string> folders_in(const fs::path& root) {
  std::vector<std::string> names;
  std::error_code error;
  for (const auto& entry : fs::directory_iterator(root, error))
    if (entry.is_directory(error)) names.push_back(entry.path().filename().string());
  std::ranges::sort(names);
  return names;
}

std::string percent(double fraction) {
  return number(100 * fraction, 1) + " %";
}

/// Prints the alignment. Returns the rotation. Throws InputError without a direction.
Eigen::Matrix3f align_scan(const PointCloud& cloud, const std::string& align) {
  print_finding("alignment", align);
  if (align == "none") return Eigen::Matrix3f::Identity();
  const Alignment found =
      principal_alignment(cloud, align == "case2" ? AlignCase::kTwo : AlignCase::kOne);
  print_finding(
      "yaw [deg]", number(double{found.yaw} * 180 / std::numbers::pi, 2),
      found.mirrored_choice ? "t22 < 0: the paper's case 1 would need a mirror image" : "");
  // Principal directions of nearby scans differ by some degrees, which can flip a small |t11|.
  constexpr float kRoundCloud = 1.1F, kNearSignChange = 0.1F;
  print_finding("eigenvalue ratio", number(found.eigenvalue_ratio, 2),
                found.eigenvalue_ratio < kRoundCloud
                    ? "near 1: the principal direction is not determined"
                    : "");
  print_finding(
      "|t11|", number(found.abs_t11, 3),
      found.abs_t11 < kNearSignChange ? "near 0: the direction may flip by 180 degrees" : "");
  return found.R_aligned_sensor;
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

}  // namespace

void print_finding(const std::string& name, const std::string& found, const std::string& advice) {
  std::cout << "  " << std::left << std::setw(18) << name << found << "\n";
  if (!advice.empty()) std::cout << std::string(20, ' ') << "-> " << advice << "\n";
}

bool print_data(const fs::path& root) {
  std::error_code none;
  const bool kitti = fs::is_directory(root / "sequences", none);
  std::string problem =
      "no usable sequence; put scans into sequences/NN/velodyne/000000.bin and on";
  if (!kitti) try {
      print_sequence(root, "");
      return true;
    } catch (const InputError& error) {
      problem = error.what();
    }
  bool any = false;
  for (const std::string& name : folders_in(kitti ? root / "sequences" : root)) try {
      print_sequence(root, name);
      any = true;
    } catch (const InputError& error) {
      if (kitti) print_finding("sequence " + name, "unusable", error.what());
    }
  if (!any) print_finding(root.string(), "unusable", problem);
  return any;
}

void print_recording(const fs::path& file) {
  const Dataset data = recorded_headers({.data = file});
  if (data.scans.empty()) throw InputError(file.string(), ": there are no scans");
  print_finding("recording", content_of(data));
}

void ScanView::declare(Options& options) {
  options.group("Range image of a scan:");
  options
      .option("images", "DIR",
              "folder for the input of a network as PNG, before hole closing "
              "(NAME_projected.png) and after (NAME_closed.png)",
              &images)
      .choice("align", {"none", "case1", "case2"}, "alignment of the scan (default case1)", &align)
      .option("gamma", "G",
              "gamma correction of the PNG files for viewing, 255 (v / 255)^(1 / G); the network's "
              "input has G = 1 (default 1)",
              &gamma)
      .positive()
      .needs("images");
  geometry.declare(options);
}

void print_scan(const fs::path& file, ScanView view) try {
  const PointCloud cloud = read_scan(file);
  const std::string sensor = view.geometry.resolve({cloud});
  const ImageGeometry geometry = view.geometry.geometry();
  print_finding("scan", file.string());
  print_finding("image", str(geometry.width, " x ", geometry.height, ", ", view.geometry.sensor));
  if (!sensor.empty()) print_finding("sensor", sensor);
  print_finding("points", str(cloud.points.size()));
  print_finding("usable points", str(std::ranges::count_if(cloud.points, is_return)));
  const Eigen::Matrix3f R_image_sensor = align_scan(cloud, view.align);
  RangeImage projected;
  project_rotated(cloud, R_image_sensor, geometry, projected);
  const double outside = projected.outside_share();
  print_finding("outside", percent(outside),
                outside > kManyOutside ? points_outside(outside, geometry, cloud) : "");
  const RangeImage closed = close_holes(projected, geometry);
  print_finding("pixels hit", percent(filled(projected)));
  print_finding("after closing", percent(filled(closed)));
  if (!view.images) return;
  make_folder(*view.images);
  const std::string stem = (*view.images / file.stem()).string();
  const auto write = [&](const char* name, const RangeImage& image) {
    const std::string png = str(stem, "_", name, ".png");
    write_gray_png(png, gray_of(brightened(image, view.gamma)));
    print_finding(name, png);
  };
  write("projected", projected);
  write("closed", closed);
} catch (const InputError& error) {
  const std::string what = error.what();
  throw InputError(what.starts_with(file.string()) ? what : str(file.string(), ": ", what));
}

}  // namespace revisit::cli
