#include "lazy_features.h"

#include <algorithm>
#include <cmath>
#include <iostream>

#include "cli/interrupt.h"
#include "cli/progress.h"
#include "revisit/proto/folder.h"
#include "revisit/proto/npy.h"

namespace revisit::cli {
namespace {

namespace fs = std::filesystem;

/// Columns of the file of times, NaN where the feature has no such stage.
constexpr std::vector<double> pipeline::DescribeTimes::*kStages[] = {
    &pipeline::DescribeTimes::read,     &pipeline::DescribeTimes::align,
    &pipeline::DescribeTimes::project,  &pipeline::DescribeTimes::close,
    &pipeline::DescribeTimes::feature,  &pipeline::DescribeTimes::write,
    &pipeline::DescribeTimes::processor};
constexpr auto kColumns = static_cast<int64_t>(std::size(kStages));

void write_times(const fs::path& file, const pipeline::DescribeTimes& times) {
  const size_t n = times.read.size();
  std::vector<float> rows;
  for (size_t i = 0; i < n; ++i)
    for (const auto stage : kStages)
      rows.push_back((times.*stage).size() == n ? static_cast<float>((times.*stage)[i])
                                                : std::nanf(""));
  proto::write_npy(file, {static_cast<int64_t>(n), kColumns}, rows.data());
}

pipeline::DescribeTimes read_times(const fs::path& file) {
  pipeline::DescribeTimes times;
  const pipeline::FeatureFile rows(file);
  if (rows.d() != kColumns) return times;  // of an earlier version: not known
  for (int64_t i = 0; i < rows.n(); ++i)
    for (size_t stage = 0; stage < std::size(kStages); ++stage)
      if (const float ms = rows.row(i)[stage]; !std::isnan(ms))
        (times.*kStages[stage]).push_back(static_cast<double>(ms));
  return times;
}

/// Their similarity to anything means nothing.
void warn_of_zeros(const pipeline::FeatureFile& features, const std::string& name) {
  int64_t zeros = 0;
  for (int64_t i = 0; i < features.n(); ++i) {
    const auto row = features.row(i);
    zeros += std::all_of(row.begin(), row.end(), [](float x) { return x == 0; }) ? 1 : 0;
  }
  if (zeros > 0)
    std::cerr << "warning: " << zeros << " of " << features.n() << " scans have no " << name
              << " (all zero): there was nothing in them that it describes\n";
}

}  // namespace

LazyFeatures::LazyFeatures(const FeatureOptions& options, const FeatureSource& source,
                           pipeline::AlignMode align, fs::path folder)
    : options_(options), source_(source) {
  describe_.geometry = options.image.geometry();
  describe_.align = align;
  describe_.threads = std::max(1, options.thread_count() / options.threads_per_scan);
  describe_.stop = interrupted;
  make_folder(folder);
  paths_ = pipeline::feature_paths(folder, source.inputs, source.extractor, describe_);
}

const pipeline::FeatureFile& LazyFeatures::file() {
  if (!file_) {
    make();
    file_.emplace(paths_.features);
    if (!source_.extractor.sees<pipeline::RangeImage>() && !options_.quiet)
      warn_of_zeros(*file_, source_.extractor.name);
  }
  return *file_;
}

const std::vector<pipeline::AlignmentRecord>& LazyFeatures::alignments() {
  if (!alignments_) {
    if (!pipeline::features_complete(paths_.alignments, paths_.key)) make();
    alignments_ = pipeline::read_alignments(paths_.alignments);
  }
  return *alignments_;
}

const pipeline::DescribeTimes& LazyFeatures::times() {
  if (!times_)
    times_ = fs::exists(times_file()) ? read_times(times_file()) : pipeline::DescribeTimes{};
  return *times_;
}

fs::path LazyFeatures::times_file() const {
  fs::path file = paths_.features;
  return file.replace_filename(file.stem().string() + "-times.npy");
}

void LazyFeatures::make() {
  Progress progress("describing", "scans", !options_.no_progress && !options_.quiet);
  describe_.progress = progress.callback();
  pipeline::DescribeTimes spent =
      pipeline::write_features(paths_, source_.inputs, source_.extractor, describe_);
  describe_.progress = {};
  if (spent.read.empty()) return;  // all were there
  write_times(times_file(), spent);
  times_ = std::move(spent);
}

}  // namespace revisit::cli
