#include <algorithm>
#include <ctime>
#include <limits>

#include "describe/in_order.h"
#include "describe/write_features.h"
#include "io/file_content.h"
#include "revisit/datasets/scan_file.h"

namespace revisit {
namespace {

namespace fs = std::filesystem;

constexpr float kUnknown = std::numeric_limits<float>::quiet_NaN();

double processor_ms() {
  timespec now{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
  return 1e3 * static_cast<double>(now.tv_sec) + 1e-6 * static_cast<double>(now.tv_nsec);
}

/// Result for one scan.
struct Described {
  std::vector<float> feature;
  AlignmentRecord alignment;
  DescribeTimes ms;         // of this scan only
  std::string skip_reason;  // "": none
};

/// With AlignCase::kNone the alignment is only recorded and may be unknown.
Alignment alignment_to_use(const PointCloud& cloud, AlignCase mode) {
  try {
    return principal_alignment(cloud, mode);
  } catch (const InputError&) {
    if (mode != AlignCase::kNone) throw;
    Alignment unknown;
    unknown.yaw = unknown.eigenvalue_ratio = unknown.abs_t11 = kUnknown;
    return unknown;
  }
}

template <class Doing>
void naming_the_file(const ScanRef& scan, const Doing& doing) {
  try {
    doing();
  } catch (const InputError& error) {
    throw InputError(scan.file.string() + ": " + error.what());
  }
}

/// True if the file can be read, so that the scan's content is at fault.
bool is_readable(const fs::path& file) {
  try {
    read_content(file);
    return true;
  } catch (const InputError&) {
    return false;
  }
}

/// Describes one scan at a time; each thread has its own.
class Describer {
 public:
  Describer(const FeatureExtractor& extractor, const DescribeOptions& options) : options_(options) {
    if (const auto* make = std::get_if<FeatureMaker<RangeImage>>(&extractor.make))
      of_range_image_ = (*make)();
    if (const auto* make = std::get_if<FeatureMaker<PointCloud>>(&extractor.make))
      of_points_ = (*make)();
    if (const auto* make = std::get_if<FeatureMaker<GrayImage>>(&extractor.make))
      of_camera_image_ = (*make)();
  }

  /// A scan that cannot be described gets a zero feature, unless options.strict.
  void describe(const ScanRef& scan, Described& result) {
    result.ms = {};
    result.skip_reason.clear();
    try {
      if (of_camera_image_)
        describe_camera_image(scan, result);
      else
        describe_points(scan, result);
    } catch (const InputError& error) {
      if (options_.strict || (!scan.read && !is_readable(scan.file))) throw;
      result.skip_reason = error.what();
      std::ranges::fill(result.feature, 0.0F);
      result.alignment = {kUnknown, kUnknown, kUnknown, kUnknown, kUnknown, 0};
    }
  }

 private:
  void describe_camera_image(const ScanRef& scan, Described& result) const {
    auto lap = stopwatch();
    const GrayImage image = read_gray_png(scan.file);
    result.ms.read = {lap()};
    const double start = processor_ms();
    naming_the_file(scan, [&] { of_camera_image_(image, result.feature); });
    result.ms.feature = {lap()};
    result.ms.processor = {processor_ms() - start};
    result.alignment = {kUnknown, kUnknown, kUnknown, kUnknown, kUnknown};
  }

  void describe_points(const ScanRef& scan, Described& result) {
    const bool is_aligned = options_.align != AlignCase::kNone;
    auto lap = stopwatch();
    read_scan_into(scan, cloud_);
    naming_the_file(scan, [&] { perturb_points(scan.frame); });
    result.ms.read = {lap()};

    const double start = processor_ms();
    Alignment alignment;
    naming_the_file(scan, [&] { alignment = alignment_to_use(cloud_, options_.align); });
    result.alignment = {alignment.yaw, alignment.eigenvalue_ratio, alignment.abs_t11,
                        alignment.mirrored_choice ? 1.0F : 0.0F, kUnknown};
    // A recorded alignment that is not applied is not part of the feature's time.
    const double feature_start = is_aligned ? start : processor_ms();
    if (of_points_ && is_aligned) rotated_ = rotated(cloud_, alignment.R_aligned_sensor);
    result.ms.align = {lap()};

    if (of_points_) {
      naming_the_file(scan, [&] { of_points_(is_aligned ? rotated_ : cloud_, result.feature); });
    } else {
      const Eigen::Matrix3f R =
          is_aligned ? alignment.R_aligned_sensor : Eigen::Matrix3f(Eigen::Matrix3f::Identity());
      project_rotated(cloud_, R, options_.geometry, image_);
      result.alignment.outside = static_cast<float>(image_.outside_share());
      result.ms.project = {lap()};
      image_ = close_holes(std::move(image_), options_.geometry);
      result.ms.close = {lap()};
      naming_the_file(scan, [&] { of_range_image_(image_, result.feature); });
    }
    result.ms.feature = {lap()};
    result.ms.processor = {processor_ms() - feature_start};
  }

  void perturb_points(int frame) {
    if (options_.perturbation.empty()) return;
    perturb(cloud_, options_.perturbation,
            uint64_t{options_.seed} << 32 | static_cast<uint32_t>(frame));
    if (std::ranges::none_of(cloud_.points, is_return))
      throw InputError("the scan has no points left after '", text_of(options_.perturbation), "'");
  }

  const DescribeOptions& options_;
  FeatureFunction<RangeImage> of_range_image_;  // one of the three is set
  FeatureFunction<PointCloud> of_points_;
  FeatureFunction<GrayImage> of_camera_image_;
  PointCloud cloud_, rotated_;
  RangeImage image_;
};

std::span<const float> floats_of(const AlignmentRecord& record) {
  static_assert(sizeof(AlignmentRecord) == kAlignmentFloats * sizeof(float));
  return {&record.yaw, kAlignmentFloats};
}

}  // namespace

DescribeTimes write_features(const fs::path& file, const std::string& key, const Dataset& dataset,
                             const FeatureExtractor& extractor, const DescribeOptions& options,
                             const Observer& observer) {
  constexpr int kFewWarnings = 5;
  DescribeTimes times;
  if (features_complete(file, key)) return times;
  if (fs::exists(fs::symlink_status(file)))
    observer.note(file.string() + " has changed since it was written; it is regenerated");
  const auto n = static_cast<int64_t>(dataset.scans.size());
  FeatureWriter writer(file, key, n, extractor.dim, kAlignmentFloats);

  const int threads = std::max(options.threads, 1);
  std::vector<Describer> describers;
  for (int t = 0; t < threads; ++t) describers.emplace_back(extractor, options);
  // Twice the threads: scans in processing, and as many that wait to be written in order.
  std::vector<Described> slots(static_cast<size_t>(threads) * 2);
  for (Described& slot : slots) slot.feature.resize(static_cast<size_t>(extractor.dim));

  const auto scan_of = [&](int64_t i) -> const ScanRef& {
    return dataset.scans[static_cast<size_t>(i)];
  };
  const Progress progress = observer.stage("describing", "scans");
  const auto check_stop = [&](int64_t done) {
    progress(done, n);
    if (done < n && observer.stop && observer.stop())
      throw Interrupted("stopped after ", done, " of ", n,
                        " scans; run the same command again to resume");
  };
  auto wall = stopwatch();
  const int64_t first = writer.rows_written();
  check_stop(first);
  int64_t skipped = 0;
  in_order(
      first, n, threads, slots,
      [&](int64_t i, int thread, Described& slot) {
        if (const int64_t ahead = i + std::ssize(slots); ahead < n) read_ahead(scan_of(ahead).file);
        describers[static_cast<size_t>(thread)].describe(scan_of(i), slot);
      },
      [&](int64_t i, Described& slot) {
        auto lap = stopwatch();
        writer.append(slot.feature, floats_of(slot.alignment));
        slot.ms.write = {lap()};
        if (slot.skip_reason.empty())
          times.append(slot.ms);
        else if (skipped++ < kFewWarnings)
          observer.warn(slot.skip_reason + "; this scan is skipped");
        check_stop(i + 1);
      });
  writer.finish();
  times.wall_ms = wall();
  return times;
}

void DescribeTimes::append(const DescribeTimes& more) {
  for (const auto stage : kDescribeStages)
    (this->*stage).insert((this->*stage).end(), (more.*stage).begin(), (more.*stage).end());
  wall_ms += more.wall_ms;
}

AlignmentRecord alignment_of(const FeatureFile& features, int64_t i) {
  const std::span<const float> floats = features.extra(i);
  if (floats.size() != kAlignmentFloats)
    throw InputError(features.path().string(), ": its rows have no records of alignments");
  return {floats[0], floats[1], floats[2], floats[3], floats[4], floats[5]};
}

}  // namespace revisit
