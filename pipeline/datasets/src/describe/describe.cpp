#include "revisit/datasets/describe.h"

#include <sys/stat.h>

#include <algorithm>
#include <ctime>
#include <limits>
#include <optional>

#include "describe/in_order.h"
#include "io/file_content.h"
#include "revisit/base/hash.h"
#include "revisit/datasets/observer.h"
#include "revisit/datasets/scan_file.h"
#include "revisit/recognition/feature_file.h"

namespace revisit {
namespace {

namespace fs = std::filesystem;

constexpr int64_t kAlignmentColumns = 6;

double processor_ms() {
  timespec now{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
  return 1e3 * static_cast<double>(now.tv_sec) + 1e-6 * static_cast<double>(now.tv_nsec);
}

std::string file_name(std::string name) {
  std::replace_if(
      name.begin(), name.end(), [](char c) { return c == '/' || c == ' '; }, '_');
  return name;
}

/// [ms]; absent if the feature has no such stage.
struct ScanTimes {
  double read = 0, feature = 0, write = 0;
  std::optional<double> align, project, close;
  double processor = 0;
};

struct Work {
  std::vector<float> feature;
  AlignmentRecord alignment;
  ScanTimes ms;
  std::string skip_reason;
};

constexpr float kNone = std::numeric_limits<float>::quiet_NaN();

struct Memory {
  PointCloud cloud, turned;
  RangeImage image;
};

/// With AlignCase::kNone the alignment is only recorded and may be unknown.
Alignment alignment_to_use(const PointCloud& cloud, AlignCase mode) {
  try {
    return principal_alignment(cloud, mode);
  } catch (const InputError&) {
    if (mode != AlignCase::kNone) throw;
    Alignment unknown;
    unknown.yaw = unknown.eigenvalue_ratio = unknown.abs_t11 = kNone;
    return unknown;
  }
}

template <class Input>
const Input& input_of(Memory& memory, const Alignment& alignment, const DescribeOptions& options,
                      Stopwatch& watch, Work& work);

template <>
const PointCloud& input_of(Memory& memory, const Alignment& alignment,
                           const DescribeOptions& options, Stopwatch& watch, Work& work) {
  if (options.align == AlignCase::kNone) return memory.cloud;
  memory.turned = rotated(memory.cloud, alignment.R_aligned_sensor);
  *work.ms.align += watch.lap();
  return memory.turned;
}

template <>
const RangeImage& input_of(Memory& memory, const Alignment& alignment,
                           const DescribeOptions& options, Stopwatch& watch, Work& work) {
  const Eigen::Matrix3f R =
      options.align == AlignCase::kNone ? Eigen::Matrix3f::Identity() : alignment.R_aligned_sensor;
  const Projected projected = project_rotated(memory.cloud, R, options.geometry, memory.image);
  work.alignment.outside = static_cast<float>(projected.outside_share());
  work.ms.project = watch.lap();
  close_holes_in_place(memory.image, options.geometry);
  work.ms.close = watch.lap();
  return memory.image;
}

template <class Doing>
void naming_the_file(const ScanRef& scan, const Doing& doing) {
  try {
    doing();
  } catch (const InputError& error) {
    throw InputError(scan.file.string() + ": " + error.what());
  }
}

void perturb_scan(const ScanRef& scan, const PerturbedScans& perturbed, PointCloud& cloud) {
  const auto frame = static_cast<uint32_t>(scan.frame);
  perturb(cloud, perturbed.perturbation, uint64_t{perturbed.seed} << 32 | frame);
  if (std::ranges::none_of(cloud.points, is_return))
    throw InputError("the scan has no points left after '", text_of(perturbed.perturbation), "'");
}

template <class Input>
void describe_scan(const ScanRef& scan, const DescribeOptions& options,
                   const FeatureFunction<Input>& describe, Memory& memory, Work& work) {
  work.ms = {};
  Stopwatch watch;
  read_scan_into(scan, memory.cloud);
  if (options.perturbed)
    naming_the_file(scan, [&] { perturb_scan(scan, *options.perturbed, memory.cloud); });
  work.ms.read = watch.lap();
  const double processor_start = processor_ms();
  Alignment alignment;
  naming_the_file(scan, [&] { alignment = alignment_to_use(memory.cloud, options.align); });
  work.ms.align = watch.lap();
  const double processor_aligned = processor_ms();
  work.alignment = {alignment.yaw, alignment.eigenvalue_ratio, alignment.abs_t11,
                    alignment.mirrored_choice ? 1.0F : 0.0F, kNone};
  const Input& input = input_of<Input>(memory, alignment, options, watch, work);
  naming_the_file(scan, [&] { describe(input, work.feature); });
  work.ms.feature = watch.lap();
  // A recorded alignment that is not applied is not part of the feature's time.
  work.ms.processor =
      processor_ms() - (options.align == AlignCase::kNone ? processor_aligned : processor_start);
}

template <>
void describe_scan(const ScanRef& scan, const DescribeOptions&,
                   const FeatureFunction<GrayImage>& describe, Memory&, Work& work) {
  work.ms = {};
  Stopwatch watch;
  const GrayImage image = read_gray_png(scan.file);
  work.ms.read = watch.lap();
  const double processor_start = processor_ms();
  naming_the_file(scan, [&] { describe(image, work.feature); });
  work.ms.feature = watch.lap();
  work.ms.processor = processor_ms() - processor_start;
  work.alignment = {kNone, kNone, kNone, kNone, kNone};
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

template <class Input>
void describe_or_zero(const ScanRef& scan, const DescribeOptions& options,
                      const FeatureFunction<Input>& describe, Memory& memory, Work& work) {
  work.skip_reason.clear();
  try {
    describe_scan(scan, options, describe, memory, work);
  } catch (const InputError& error) {
    if (options.strict || (!scan.read && !is_readable(scan.file))) throw;
    work.skip_reason = error.what();
    std::fill(work.feature.begin(), work.feature.end(), 0.0F);
    work.alignment = {kNone, kNone, kNone, kNone, kNone, 0};
  }
}

void append(const ScanTimes& ms, DescribeTimes& times) {
  const auto add = [](const std::optional<double>& value, std::vector<double>& values) {
    if (value) values.push_back(*value);
  };
  add(ms.read, times.read);
  add(ms.align, times.align);
  add(ms.project, times.project);
  add(ms.close, times.close);
  add(ms.feature, times.feature);
  add(ms.write, times.write);
  add(ms.processor, times.processor);
}

std::span<const float> as_row(const AlignmentRecord& record) {
  static_assert(sizeof(AlignmentRecord) == kAlignmentColumns * sizeof(float));
  return {&record.yaw, kAlignmentColumns};
}

class Output {
 public:
  Output(const fs::path& file, const std::string& key, int64_t n, int64_t dim,
         const DescribeOptions& options)
      : n_(n) {
    if (features_complete(file, key)) return;
    if (options.corrupt && fs::exists(fs::symlink_status(file))) options.corrupt(file.string());
    writer_.emplace(file, key, n, dim);
  }
  bool complete() const { return !writer_; }
  int64_t rows() const { return writer_ ? writer_->rows_written() : n_; }
  /// After an interruption between the two, one file may be one row ahead of the other.
  void append(int64_t i, std::span<const float> row) {
    if (rows() == i) writer_->append(row);
  }
  void finish() {
    if (writer_) writer_->finish();
  }

 private:
  int64_t n_;
  std::optional<FeatureWriter> writer_;
};

}  // namespace

void DescribeTimes::append(const DescribeTimes& more) {
  for (const auto stage :
       {&DescribeTimes::read, &DescribeTimes::align, &DescribeTimes::project, &DescribeTimes::close,
        &DescribeTimes::feature, &DescribeTimes::write, &DescribeTimes::processor})
    (this->*stage).insert((this->*stage).end(), (more.*stage).begin(), (more.*stage).end());
  wall_ms += more.wall_ms;
}

std::string dataset_key(const Dataset& dataset) {
  std::string files;
  for (const ScanRef& scan : dataset.scans) {
    if (scan.read) {
      files += str(fs::absolute(scan.file).string(), " ", scan.checksum, "\n");
      continue;
    }
    struct stat s {};  // all zero for a missing file: its reader reports it
    if (::stat(scan.file.c_str(), &s) != 0) s = {};
    files +=
        str(fs::absolute(scan.file).string(), " ", s.st_size, " ", s.st_mtim.tv_sec, ".",
            s.st_mtim.tv_nsec, " ", s.st_ino, " ", s.st_ctim.tv_sec, ".", s.st_ctim.tv_nsec, "\n");
  }
  return str("scans ", dataset.scans.size(), " ", short_name_of(files));
}

FeaturePaths feature_paths(const fs::path& folder, const Dataset& dataset,
                           const FeatureExtractor& extractor, const DescribeOptions& options) {
  FeaturePaths paths;
  paths.key = str("version ", kFeatureVersion, "\n", extractor.key, "\nalign ",
                  name_of(options.align), "\n", dataset_key(dataset), "\n");
  if (options.perturbed)
    paths.key += str("altered ", text_of(options.perturbed->perturbation), ", seed ",
                     options.perturbed->seed, ", version ", kPerturbationVersion, "\n");
  const std::string stem =
      file_name(extractor.name) + "-" + name_of(options.align) + "-" + short_name_of(paths.key);
  paths.features = folder / (stem + ".npy");
  paths.alignments = folder / (stem + "-scans.npy");
  return paths;
}

namespace {

template <class Input>
DescribeTimes write_features_of(const FeaturePaths& paths, const Dataset& dataset, int64_t dim,
                                const FeatureMaker<Input>& make, const DescribeOptions& options) {
  DescribeTimes times;
  const auto n = static_cast<int64_t>(dataset.scans.size());
  Output alignments(paths.alignments, paths.key, n, kAlignmentColumns, options);
  Output features(paths.features, paths.key, n, dim, options);
  if (alignments.complete() && features.complete()) return times;

  const int threads = std::max(options.threads, 1);
  std::vector<FeatureFunction<Input>> functions;
  for (int t = 0; t < threads; ++t) functions.push_back(make());
  std::vector<Memory> memories(static_cast<size_t>(threads));
  // Twice the threads: scans in processing, and as many that wait to be written in order.
  std::vector<Work> slots(static_cast<size_t>(threads) * 2);
  for (Work& work : slots) work.feature.resize(static_cast<size_t>(dim));

  const int64_t first = std::min(features.rows(), alignments.rows());
  const auto ahead = static_cast<int64_t>(slots.size());
  const auto check_stop = [&](int64_t done) {
    if (options.progress) options.progress(done, n);
    if (done < n && options.stop && options.stop())
      throw Interrupted("stopped after ", done, " of ", n,
                        " scans; run the same command again to resume");
  };
  Stopwatch wall;
  check_stop(first);
  in_order(
      first, n, threads, slots,
      [&](int64_t i, int thread, Work& work) {
        if (i + ahead < n) read_ahead(dataset.scans[static_cast<size_t>(i + ahead)].file);
        const auto t = static_cast<size_t>(thread);
        describe_or_zero(dataset.scans[static_cast<size_t>(i)], options, functions[t], memories[t],
                         work);
      },
      [&](int64_t i, Work& work) {
        Stopwatch watch;
        alignments.append(i, as_row(work.alignment));
        features.append(i, work.feature);
        work.ms.write = watch.lap();
        if (work.skip_reason.empty())
          append(work.ms, times);
        else if (options.skipped)
          options.skipped(dataset.scans[static_cast<size_t>(i)], work.skip_reason);
        check_stop(i + 1);
      });
  alignments.finish();
  features.finish();
  times.wall_ms = wall.lap();
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
  if (rows.d() != kAlignmentColumns)
    throw InputError(file.string(), ": expected rows of ", kAlignmentColumns, " values, found ",
                     rows.d());
  std::vector<AlignmentRecord> records;
  for (int64_t i = 0; i < rows.n(); ++i) {
    const auto row = rows.row(i);
    records.push_back({row[0], row[1], row[2], row[3], row[4], row[5]});
  }
  return records;
}

}  // namespace revisit
