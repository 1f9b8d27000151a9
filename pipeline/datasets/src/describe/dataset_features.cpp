#include <algorithm>
#include <cmath>

#include "revisit/base/files.h"
#include "revisit/datasets/describe.h"
#include "revisit/proto/npy.h"

namespace revisit {
namespace {

namespace fs = std::filesystem;

/// Columns of the file of times, NaN if the feature has no such stage.
constexpr std::vector<double> DescribeTimes::*kStages[] = {
    &DescribeTimes::read,    &DescribeTimes::align, &DescribeTimes::project,  &DescribeTimes::close,
    &DescribeTimes::feature, &DescribeTimes::write, &DescribeTimes::processor};
constexpr auto kColumns = static_cast<int64_t>(std::size(kStages));

void write_times(const fs::path& file, const DescribeTimes& times) {
  const size_t n = times.read.size();
  std::vector<float> rows;
  for (size_t i = 0; i < n; ++i)
    for (const auto stage : kStages)
      rows.push_back((times.*stage).size() == n ? static_cast<float>((times.*stage)[i])
                                                : std::nanf(""));
  proto::write_npy(file, {static_cast<int64_t>(n), kColumns}, rows.data());
}

}  // namespace

DatasetFeatures::DatasetFeatures(const Dataset& dataset, const FeatureExtractor& extractor,
                                 const DescribeOptions& options, const fs::path& folder,
                                 const Observer& observer)
    : dataset_(dataset), extractor_(extractor), observer_(observer), options_(options) {
  options_.stop = observer.stop;
  options_.corrupt = [this](const std::string& file) {
    observer_.note(file + " has changed since it was written; it is regenerated");
  };
  make_folder(folder);
  paths_ = feature_paths(folder, dataset, extractor, options_);
}

const FeatureFile& DatasetFeatures::file() {
  if (!file_) {
    make();
    file_.emplace(paths_.features);
    if (!extractor_.sees<RangeImage>()) warn_of_zeros(*file_);
  }
  return *file_;
}

const std::vector<AlignmentRecord>& DatasetFeatures::alignments() {
  if (!alignments_) {
    if (!features_complete(paths_.alignments, paths_.key)) make();
    alignments_ = read_alignments(paths_.alignments);
    const std::vector<int64_t> none = skipped();
    if (none.empty()) return *alignments_;
    const std::string first = dataset_.scans[static_cast<size_t>(none[0])].file.string();
    if (static_cast<int64_t>(none.size()) == n())
      throw InputError(first, ": cannot be described, like all ", n(),
                       " scans; check that the data are complete and of the right kind");
    if (options_.strict)
      throw InputError(first, ": cannot be described, like ", none.size() - 1, " others of the ",
                       n());
  }
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
  fs::path file = paths_.features;
  return file.replace_filename(file.stem().string() + "-times.npy");
}

/// Ignores a corrupt file, because no result depends on it.
DescribeTimes DatasetFeatures::read_times() const {
  DescribeTimes times;
  try {
    const FeatureFile rows(times_file());
    if (rows.d() != kColumns || rows.n() > n()) return times;
    for (int64_t i = 0; i < rows.n(); ++i)
      for (size_t stage = 0; stage < std::size(kStages); ++stage)
        if (const float ms = rows.row(i)[stage]; !std::isnan(ms))
          (times.*kStages[stage]).push_back(static_cast<double>(ms));
  } catch (const InputError& error) {
    observer_.note(str(error.what(), "; the times of describing are unknown"));
  }
  return times;
}

void DatasetFeatures::warn_of_zeros(const FeatureFile& features) {
  int64_t zeros = 0;
  for (int64_t i = 0; i < features.n(); ++i) {
    const auto row = features.row(i);
    zeros += std::all_of(row.begin(), row.end(), [](float x) { return x == 0; }) ? 1 : 0;
  }
  zeros -= static_cast<int64_t>(skipped().size());  // reported elsewhere
  if (zeros > 0)
    observer_.warn(str(zeros, " of ", features.n(), " scans have no ", extractor_.name,
                       " (all zero): they contain nothing that it describes"));
}

void DatasetFeatures::make() {
  if (made_) return;
  options_.progress = observer_.stage("describing", "scans");
  options_.skipped = [this, said = 0](const ScanRef&, const std::string& why) mutable {
    constexpr int kFew = 5;
    if (said++ < kFew) observer_.warn(why + "; this scan is skipped");
  };
  DescribeTimes spent = write_features(paths_, dataset_, extractor_, options_);
  made_ = true;
  options_.progress = {};
  if (spent.read.empty()) return;  // all were cached
  write_times(times_file(), spent);
  times_ = std::move(spent);
}

}  // namespace revisit
