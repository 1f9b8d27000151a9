#include <sys/stat.h>

#include <algorithm>
#include <cmath>

#include "describe/write_features.h"
#include "revisit/base/files.h"
#include "revisit/base/hash.h"
#include "revisit/proto/npy.h"

namespace revisit {
namespace {

namespace fs = std::filesystem;

constexpr auto kStageCount = static_cast<int64_t>(std::size(kDescribeStages));

/// Columns are the stages, NaN if the feature has no such stage.
void write_times(const fs::path& file, const DescribeTimes& times) {
  const size_t n = times.read.size();
  std::vector<float> rows;
  for (size_t i = 0; i < n; ++i)
    for (const auto stage : kDescribeStages)
      rows.push_back((times.*stage).size() == n ? static_cast<float>((times.*stage)[i])
                                                : std::nanf(""));
  proto::write_npy(file, {static_cast<int64_t>(n), kStageCount}, rows.data());
}

std::string key_of(const Dataset& dataset, const FeatureExtractor& extractor,
                   const DescribeOptions& options) {
  std::string key = str("version ", kFeatureVersion, "\n", extractor.key, "\nalign ",
                        name_of(options.align), "\n", dataset_key(dataset), "\n");
  if (!options.perturbation.empty())
    key += str("perturbed ", text_of(options.perturbation), ", seed ", options.seed, ", version ",
               kPerturbationVersion, "\n");
  return key;
}

}  // namespace

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

DatasetFeatures::DatasetFeatures(const Dataset& dataset, const FeatureExtractor& extractor,
                                 const DescribeOptions& options, const fs::path& folder,
                                 const Observer& observer)
    : dataset_(dataset),
      extractor_(extractor),
      observer_(observer),
      options_(options),
      key_(key_of(dataset, extractor, options)) {
  make_folder(folder);
  std::string name = extractor.name;
  std::ranges::replace_if(
      name, [](char c) { return c == '/' || c == ' '; }, '_');
  path_ = folder / str(name, "-", name_of(options.align), "-", short_name_of(key_), ".features");
}

const FeatureFile& DatasetFeatures::open() {
  if (file_) return *file_;
  DescribeTimes spent = write_features(path_, key_, dataset_, extractor_, options_, observer_);
  if (!spent.read.empty()) {
    write_times(times_file(), spent);
    times_ = std::move(spent);
  }
  return file_.emplace(path_);
}

const FeatureFile& DatasetFeatures::file() {
  open();
  if (!zeros_counted_ && !extractor_.sees<RangeImage>()) warn_of_zeros();
  return *file_;
}

const std::vector<AlignmentRecord>& DatasetFeatures::alignments() {
  if (alignments_) return *alignments_;
  const FeatureFile& features = open();
  alignments_.emplace();
  for (int64_t i = 0; i < features.n(); ++i) alignments_->push_back(alignment_of(features, i));
  const std::vector<int64_t> none = skipped();
  if (none.empty()) return *alignments_;
  const std::string first = dataset_.scans[static_cast<size_t>(none[0])].file.string();
  if (static_cast<int64_t>(none.size()) == n())
    throw InputError(first, ": cannot be described, like all ", n(),
                     " scans; check that the data are complete and of the right kind");
  if (options_.strict)
    throw InputError(first, ": cannot be described, like ", none.size() - 1, " others of the ",
                     n());
  return *alignments_;
}

std::vector<int64_t> DatasetFeatures::skipped() {
  const std::vector<AlignmentRecord>& records = alignments();
  std::vector<int64_t> rows;
  for (size_t i = 0; i < records.size(); ++i)
    if (records[i].described == 0) rows.push_back(static_cast<int64_t>(i));
  return rows;
}

const DescribeTimes& DatasetFeatures::times() {
  if (!times_) times_ = fs::exists(times_file()) ? read_times() : DescribeTimes{};
  return *times_;
}

fs::path DatasetFeatures::times_file() const {
  fs::path file = path_;
  return file.replace_filename(file.stem().string() + "-times.npy");
}

/// Ignores a corrupt file, because no result depends on it.
DescribeTimes DatasetFeatures::read_times() const {
  DescribeTimes times;
  try {
    const FeatureFile rows(times_file());
    if (rows.d() != kStageCount || rows.n() > n()) return times;
    for (int64_t i = 0; i < rows.n(); ++i)
      for (size_t stage = 0; stage < std::size(kDescribeStages); ++stage)
        if (const float ms = rows.row(i)[stage]; !std::isnan(ms))
          (times.*kDescribeStages[stage]).push_back(static_cast<double>(ms));
  } catch (const InputError& error) {
    observer_.note(str(error.what(), "; the times of describing are unknown"));
  }
  return times;
}

void DatasetFeatures::warn_of_zeros() {
  zeros_counted_ = true;
  int64_t zeros = 0;
  for (int64_t i = 0; i < file_->n(); ++i)  // skipped scans are reported elsewhere
    zeros += alignment_of(*file_, i).described != 0 &&
                     std::ranges::all_of(file_->row(i), [](float x) { return x == 0; })
                 ? 1
                 : 0;
  if (zeros > 0)
    observer_.warn(str(zeros, " of ", file_->n(), " scans have no ", extractor_.name,
                       " (all zero): they contain nothing that it describes"));
}

}  // namespace revisit
