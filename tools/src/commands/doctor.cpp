#include <fstream>
#include <iomanip>
#include <iostream>
#include <numbers>
#include <set>

#include "cli/command.h"
#include "cli/geometry_options.h"
#include "cli/net_arrays.h"
#include "cli/net_options.h"
#include "cli/terminal.h"
#include "eval/feature_options.h"
#include "loops/recording.h"
#include "revisit/base/files.h"
#include "revisit/datasets/scan_file.h"
#include "revisit/engine/machine.h"
#include "revisit/recognition/align.h"
#include "revisit/recognition/ring/descriptor.h"
#include "revisit/recognition/ring/model.h"

namespace revisit::cli {
namespace {

namespace fs = std::filesystem;

/// A line, and below it the advice, if there is one.
void print_finding(const std::string& name, const std::string& found,
                   const std::string& advice = "") {
  std::cout << "  " << std::left << std::setw(18) << name << found << "\n";
  if (!advice.empty()) std::cout << std::string(20, ' ') << "-> " << advice << "\n";
}

std::vector<float> output_of(const engine::Net& net, bool reference_kernels) {
  const engine::Shape input{1, net.inputs().at(0).shape[1], 67,
                            131};  // no multiple of a block size
  const std::string& name = net.inputs()[0].name;
  engine::Run run(net.plan({{name, input}}, {.reference_kernels = reference_kernels}));
  size_t i = 0;
  for (float& value : run.input(name).values()) value = static_cast<float>(i++ * 37 % 256) - 128;
  run.forward();
  const auto output = run.output(net.outputs().at(0)).values();
  return {output.begin(), output.end()};
}

bool self_test() {
  constexpr double kTolerance = 1e-4;
  try {
    const engine::Net net = ring_net(shipped_ring_model("hdl64"));
    const double deviation = relative_error(output_of(net, false), output_of(net, true));
    const bool good = deviation <= kTolerance;
    print_finding(
        "self-test", str("a network by fast kernels against the reference: ", deviation),
        good ? "" : "networks compute wrong results on this machine; please report this output");
    return good;
  } catch (const std::exception& error) {
    print_finding("self-test", error.what(), "networks do not run here; please report this output");
    return false;
  }
}

std::string cpu_name() {
  std::ifstream in("/proc/cpuinfo");
  for (std::string line; std::getline(in, line);)
    if (line.starts_with("model name")) return line.substr(line.find(": ") + 2);
  return "unknown";
}

/// The build, the machine, and whether networks compute here. Returns the latter.
bool print_installation() {
  print_finding("revisit", REVISIT_VERSION);
#ifdef __OPTIMIZE__
  print_finding("build", str("g++ ", __VERSION__, ", optimized"));
#else
  print_finding("build", str("g++ ", __VERSION__, ", not optimized"),
                "many times slower; build with 'cmake --preset release'");
#endif
  print_finding("CPU", cpu_name());
  const std::string simd = engine::simd_target();
  print_finding("SIMD", "kernels use " + simd,
                simd.starts_with("SSE") ? "networks run several times slower than with AVX2" : "");
  print_finding("OpenBLAS", "kernels for " + engine::blas_core(), joined(slow_settings(), "; "));
  return self_test();
}

/// "7 places with 77 scans", or "12 scans, 4541 poses, no times".
std::string content_of(const Dataset& data) {
  const std::string scans = plural(std::ssize(data.scans), "scan");
  if (!data.has_places())
    return str(scans, ", ", data.n_poses ? plural(data.n_poses, "pose") : "no poses", ", ",
               data.scans[0].time ? "times" : "no times");
  std::set<std::string> places;
  for (const ScanRef& scan : data.scans) places.insert(scan.place);
  return plural(std::ssize(places), "place") + " with " + scans;
}

/// Throws InputError if there is no such data.
void print_sequence(const fs::path& root, const std::string& sequence) {
  const Dataset data = open_dataset(root, sequence);
  std::vector<std::string> advice = data.warnings;
  const auto empty = std::ranges::count_if(data.scans, [](const ScanRef& scan) {
    std::error_code error;
    return fs::file_size(scan.file, error) == 0 && !error;
  });
  if (empty > 0) advice.push_back(plural(empty, "scan file") + " empty; copy the data set again");
  if (!data.has_places() && !data.sequence.empty() && !data.has_poses())
    advice.emplace_back("no ground truth, so evaluation is not possible");
  print_finding(
      data.sequence.empty() ? "scans" : (data.has_places() ? "set " : "sequence ") + data.sequence,
      content_of(data), joined(advice, "; "));
}

/// Prints sequences of KITTI, sets of places, or a folder of scans. Returns whether any is usable.
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
  std::set<std::string> names;
  for (const auto& entry : fs::directory_iterator(kitti ? root / "sequences" : root, none))
    if (entry.is_directory(none)) names.insert(entry.path().filename());
  bool any = false;
  for (const std::string& name : names) try {
      print_sequence(root, name);
      any = true;
    } catch (const InputError& error) {
      if (kitti) print_finding("sequence " + name, "unusable", error.what());
    }
  if (!any) print_finding(root.string(), "unusable", problem);
  return any;
}

/// Throws what read_recording() throws.
void print_recording(const fs::path& file) {
  const Dataset data = headers_of({.data = file});
  if (data.scans.empty()) throw InputError(file.string(), ": there are no scans");
  print_finding("recording", content_of(data));
}

/// Prints the alignment. Returns the rotation. Throws InputError without a direction.
Eigen::Matrix3f align_scan(const PointCloud& cloud, const std::string& align) {
  print_finding("alignment", align);
  if (align == "none") return Eigen::Matrix3f::Identity();
  const Alignment found = principal_alignment(cloud, parse_align_case(align));
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

std::string percent(double fraction) {
  return number(100 * fraction, 1) + " %";
}

std::string filled(const RangeImage& image) {
  const auto n = static_cast<double>(image.pixels.size());
  return percent(1 - static_cast<double>(std::ranges::count(image.pixels, 0.0F)) / n);
}

struct DoctorOptions {
  std::optional<fs::path> data, images;  // images: folder of the PNG files
  std::string align = "case1";
  GeometryOptions geometry;

  void declare(Options& options) {
    options.argument("DATA", &data)
        .optional()
        .group("Range image of a scan:")
        .option("images", "DIR",
                "folder for the input of a network as PNG, before hole closing "
                "(NAME_projected.png) and after (NAME_closed.png)",
                &images)
        .choice("align", {"none", "case1", "case2"}, "alignment of the scan (default case1)",
                &align);
    geometry.declare(options);
  }
};

void write_image(const DoctorOptions& o, const std::string& name, const RangeImage& image) {
  make_folder(*o.images);
  const std::string file = (*o.images / str(o.data->stem().string(), "_", name, ".png")).string();
  write_gray_png(file, gray_of(image));
  print_finding(name, file);
}

/// Prints points, alignment and range image. Throws InputError if the scan cannot be read or
/// aligned.
void print_scan(DoctorOptions& o) try {
  const PointCloud cloud = read_scan(*o.data);
  const std::string sensor = o.geometry.resolve({cloud});
  const ImageGeometry geometry = o.geometry.geometry();
  print_finding("scan", o.data->string());
  print_finding("image", str(geometry.width, " x ", geometry.height, ", ", o.geometry.sensor));
  if (!sensor.empty()) print_finding("sensor", sensor);
  print_finding("points", str(cloud.points.size()));
  PointCloud usable;
  std::ranges::copy_if(cloud.points, std::back_inserter(usable.points), is_return);
  print_finding("usable points", str(usable.points.size()));
  if (!usable.points.empty()) {
    const auto [model, reason] = choose_ring_model({usable});
    print_finding("ring model", str(model, " (", reason, ")"));
  }
  RangeImage projected;
  project_rotated(cloud, align_scan(cloud, o.align), geometry, projected);
  const double outside = projected.outside_share();
  print_finding("outside", percent(outside),
                outside > kManyOutside ? points_outside(outside, geometry, cloud) : "");
  const RangeImage closed = close_holes(projected, geometry);
  print_finding("pixels hit", filled(projected));
  print_finding("after closing", filled(closed));
  if (!o.images) return;
  write_image(o, "projected", projected);
  write_image(o, "closed", closed);
} catch (const InputError& error) {
  const std::string what = error.what(), file = o.data->string();
  throw InputError(what.starts_with(file) ? what : str(file, ": ", what));
}

int examine(DoctorOptions& o) {
  std::error_code none;
  const bool recorded = o.data && is_recording(*o.data);
  if (o.data && !recorded && fs::is_regular_file(*o.data, none)) {
    print_scan(o);
    return kOk;
  }
  if (o.images) throw UsageError("--images: expected a scan file as DATA");
  if (recorded) {
    print_recording(*o.data);
    return kOk;
  }
  if (o.data) return print_data(*o.data) ? kOk : kCheckFailed;
  return print_installation() ? kOk : kCheckFailed;
}

}  // namespace

Command doctor_command() {
  return {"doctor", "examine the installation, a data set or a scan",
          "Prints what the program finds and how to fix it: its build, the kernels for this "
          "machine, and whether networks compute; or, with DATA, the sequences of a data set, the "
          "scans of a recording, or the points, the alignment and the range image of a scan (.bin, "
          ".pcd or .ply). Exit code 5 if networks do not compute, or DATA is unusable.",
          "  revisit doctor\n"
          "  revisit doctor /data/kitti\n"
          "  revisit doctor sequences/00/velodyne/000052.bin --images look\n"
          "  revisit doctor scan.pcd --sensor vlp16 --align none --images look\n",
          with_options<DoctorOptions>(examine)};
}

}  // namespace revisit::cli
