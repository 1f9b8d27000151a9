#include "revisit/pipeline/describe.h"

#include <omp.h>

#include <algorithm>
#include <chrono>
#include <exception>
#include <limits>

#include "describe/keys.h"
#include "revisit/pipeline/feature_file.h"
#include "revisit/pipeline/scan_file.h"

namespace revisit::pipeline {
namespace {

namespace fs = std::filesystem;
using Clock = std::chrono::steady_clock;

constexpr const char* kAlignModes[] = {"none", "case1", "case2"};

double milliseconds(Clock::time_point begin, Clock::time_point end) {
  return std::chrono::duration<double, std::milli>(end - begin).count();
}

std::string file_name(std::string name) {
  std::replace_if(
      name.begin(), name.end(), [](char c) { return c == '/' || c == ' '; }, '_');
  return name;
}

/// One scan on its way to a feature, with what was measured.
struct Work {
  std::vector<float> feature;
  AlignmentRecord alignment;
  double read_ms = 0, image_ms = 0, feature_ms = 0;
  std::exception_ptr error;
};

Alignment alignment_for(const PointCloud& cloud, AlignMode mode) {
  return principal_alignment(cloud, mode == AlignMode::kCase2 ? AlignCase::kTwo : AlignCase::kOne);
}

/// What a feature is computed from, of one scan.
template <class Input>
Input input_of(const PointCloud& cloud, const Alignment& alignment, const DescribeOptions& options);

template <>
PointCloud input_of(const PointCloud& cloud, const Alignment& alignment,
                    const DescribeOptions& options) {
  return options.align == AlignMode::kNone ? cloud : rotated(cloud, alignment.R_aligned_sensor);
}

template <>
RangeImage input_of(const PointCloud& cloud, const Alignment& alignment,
                    const DescribeOptions& options) {
  return close_holes(project(input_of<PointCloud>(cloud, alignment, options), options.geometry),
                     options.geometry);
}

template <class Input>
void describe_scan(const ScanRef& scan, const DescribeOptions& options,
                   const FeatureFunction<Input>& describe, Work& work) {
  const Clock::time_point start = Clock::now();
  const PointCloud cloud = read_scan(scan.file);
  const Clock::time_point have_points = Clock::now();
  Alignment alignment;
  try {
    alignment = alignment_for(cloud, options.align);
  } catch (const InputError& error) {
    throw InputError(scan.file.string() + ": " + error.what());
  }
  const auto input = input_of<Input>(cloud, alignment, options);
  const Clock::time_point have_input = Clock::now();
  describe(input, work.feature);
  work.alignment = {alignment.yaw, alignment.eigenvalue_ratio, alignment.abs_t11,
                    alignment.mirrored_choice ? 1.0F : 0.0F};
  work.read_ms = milliseconds(start, have_points);
  work.image_ms = milliseconds(have_points, have_input);
  work.feature_ms = milliseconds(have_input, Clock::now());
}

template <>
void describe_scan(const ScanRef& scan, const DescribeOptions&,
                   const FeatureFunction<GrayImage>& describe, Work& work) {
  constexpr float kNone = std::numeric_limits<float>::quiet_NaN();
  const Clock::time_point start = Clock::now();
  const GrayImage image = read_gray_png(scan.file);
  const Clock::time_point have_image = Clock::now();
  describe(image, work.feature);
  work.alignment = {kNone, kNone, kNone, kNone};
  work.read_ms = milliseconds(start, have_image);
  work.feature_ms = milliseconds(have_image, Clock::now());
}

std::span<const float> as_row(const AlignmentRecord& record) {
  static_assert(sizeof(AlignmentRecord) == 4 * sizeof(float));
  return {&record.yaw, 4};
}

}  // namespace

AlignMode parse_align_mode(const std::string& text) {
  for (size_t i = 0; i < std::size(kAlignModes); ++i)
    if (text == kAlignModes[i]) return static_cast<AlignMode>(i);
  throw UsageError("alignment: expected none, case1 or case2, found '" + text + "'");
}

const char* name_of(AlignMode mode) {
  return kAlignModes[static_cast<size_t>(mode)];
}

RangeImage scan_to_image(const PointCloud& cloud, AlignMode mode, const ImageGeometry& geometry) {
  if (mode == AlignMode::kNone) return close_holes(project(cloud, geometry), geometry);
  return close_holes(project(rotated(cloud, alignment_for(cloud, mode).R_aligned_sensor), geometry),
                     geometry);
}

FeaturePaths feature_paths(const fs::path& folder, const Dataset& dataset,
                           const FeatureExtractor& extractor, const DescribeOptions& options) {
  FeaturePaths paths;
  paths.key =
      str(extractor.key, "\nalign ", name_of(options.align), "\n", dataset_key(dataset), "\n");
  const std::string stem =
      file_name(extractor.name) + "-" + name_of(options.align) + "-" + short_name_of(paths.key);
  paths.features = folder / (stem + ".npy");
  paths.alignments = folder / (stem + "-alignment.npy");
  return paths;
}

namespace {

template <class Input>
DescribeTimes write_features_of(const FeaturePaths& paths, const Dataset& dataset, int64_t dim,
                                const FeatureMaker<Input>& make, const DescribeOptions& options) {
  DescribeTimes times;
  if (features_complete(paths.features, paths.key) &&
      features_complete(paths.alignments, paths.key))
    return times;
  const auto n = static_cast<int64_t>(dataset.scans.size());
  FeatureWriter alignments(paths.alignments, paths.key, n, 4);
  FeatureWriter features(paths.features, paths.key, n, dim);

  const int threads = std::max(options.threads, 1);
  std::vector<FeatureFunction<Input>> functions;
  for (int t = 0; t < threads; ++t) functions.push_back(make());
  // A few scans a thread at a time: rows are written in order, and little is lost on a stop.
  std::vector<Work> batch(static_cast<size_t>(threads) * 2);
  for (Work& work : batch) work.feature.resize(static_cast<size_t>(dim));

  int64_t next = std::min(features.rows_written(), alignments.rows_written());
  while (next < n) {
    if (options.progress) options.progress(next, n);
    if (options.stop && options.stop())
      throw Interrupted(str("stopped after ", next, " of ", n,
                            " scans; they are kept, the same command goes on"));
    const int64_t count = std::min<int64_t>(static_cast<int64_t>(batch.size()), n - next);
#pragma omp parallel for num_threads(threads) schedule(dynamic, 1)
    for (int64_t i = 0; i < count; ++i) {
      Work& work = batch[static_cast<size_t>(i)];
      work.error = nullptr;
      try {
        describe_scan(dataset.scans[static_cast<size_t>(next + i)], options,
                      functions[static_cast<size_t>(omp_get_thread_num())], work);
      } catch (...) {
        work.error = std::current_exception();
      }
    }
    for (int64_t i = 0; i < count; ++i, ++next) {
      const Work& work = batch[static_cast<size_t>(i)];
      if (work.error) std::rethrow_exception(work.error);
      // After a stop between the two, one file is a row ahead of the other.
      if (alignments.rows_written() == next) alignments.append(as_row(work.alignment));
      if (features.rows_written() == next) features.append(work.feature);
      times.read.push_back(work.read_ms);
      times.image.push_back(work.image_ms);
      times.feature.push_back(work.feature_ms);
    }
  }
  if (options.progress) options.progress(n, n);
  alignments.finish();
  features.finish();
  return times;
}

}  // namespace

DescribeTimes write_features(const FeaturePaths& paths, const Dataset& dataset,
                             const FeatureExtractor& extractor, const DescribeOptions& options) {
  return std::visit(
      [&](const auto& make) {
        return write_features_of(paths, dataset, extractor.dim, make, options);
      },
      extractor.make);
}

std::vector<AlignmentRecord> read_alignments(const fs::path& file) {
  const FeatureFile rows(file);
  if (rows.d() != 4)
    throw InputError(str(file.string(), ": expected rows of 4 numbers, found ", rows.d()));
  std::vector<AlignmentRecord> records;
  for (int64_t i = 0; i < rows.n(); ++i) {
    const auto row = rows.row(i);
    records.push_back({row[0], row[1], row[2], row[3]});
  }
  return records;
}

}  // namespace revisit::pipeline
