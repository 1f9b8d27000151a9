#include "lazy_features.h"

#include <algorithm>
#include <cmath>
#include <iostream>

#include "cli/interrupt.h"
#include "cli/messages.h"
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

/// Says the reasons of the first few scans that are left out.
class LeftOut {
 public:
  explicit LeftOut(bool quiet) : quiet_(quiet) {}
  void operator()(const pipeline::ScanRef&, const std::string& why) {
    constexpr int kFew = 5;
    if (!quiet_ && said_++ < kFew) warn(why + "; this scan is left out");
  }

 private:
  bool quiet_;
  int said_ = 0;
};

}  // namespace

LazyFeatures::LazyFeatures(const FeatureOptions& options, const FeatureSource& source,
                           pipeline::AlignCase align, fs::path folder)
    : options_(options), source_(source) {
  describe_.geometry = options.image.geometry();
  describe_.align = align;
  describe_.threads = std::max(1, options.thread_count() / options.threads_per_scan);
  describe_.strict = options.strict;
  describe_.stop = interrupted;
  if (!options.quiet)
    describe_.damaged = [](const std::string& file) {
      std::cerr << "note: " << file << " is not what was written; it is made anew\n";
    };
  make_folder(folder);
  paths_ = pipeline::feature_paths(folder, source.inputs, source.extractor, describe_);
}

const pipeline::FeatureFile& LazyFeatures::file() {
  if (!file_) {
    make();
    file_.emplace(paths_.features);
    if (!source_.extractor.sees<pipeline::RangeImage>() && !options_.quiet) warn_of_zeros(*file_);
  }
  return *file_;
}

const std::vector<pipeline::AlignmentRecord>& LazyFeatures::alignments() {
  if (!alignments_) {
    if (!pipeline::features_complete(paths_.alignments, paths_.key)) make();
    alignments_ = pipeline::read_alignments(paths_.alignments);
    const std::vector<int64_t> none = left_out();
    if (none.empty()) return *alignments_;
    const std::string first = source_.inputs.scans[static_cast<size_t>(none[0])].file.string();
    if (static_cast<int64_t>(none.size()) == n())
      throw InputError(str(first, ": this scan, and every other of the ", n(),
                           ", cannot be described; is it the right data, and whole?"));
    if (options_.strict)
      throw InputError(str(first, ": cannot be described, nor ", none.size() - 1, " others of the ",
                           n(), "; without --strict they are left out"));
  }
  return *alignments_;
}

std::vector<int64_t> LazyFeatures::left_out() {
  const std::vector<pipeline::AlignmentRecord>& records = alignments();
  std::vector<int64_t> rows;
  for (size_t i = 0; i < records.size(); ++i)
    if (records[i].described == 0) rows.push_back(static_cast<int64_t>(i));
  return rows;
}

const pipeline::DescribeTimes& LazyFeatures::times() {
  if (!times_) times_ = fs::exists(times_file()) ? read_times() : pipeline::DescribeTimes{};
  return *times_;
}

fs::path LazyFeatures::times_file() const {
  fs::path file = paths_.features;
  return file.replace_filename(file.stem().string() + "-times.npy");
}

/// What is damaged is not known: no figure depends on it.
pipeline::DescribeTimes LazyFeatures::read_times() const {
  pipeline::DescribeTimes times;
  try {
    const pipeline::FeatureFile rows(times_file());
    if (rows.d() != kColumns || rows.n() > n()) return times;
    for (int64_t i = 0; i < rows.n(); ++i)
      for (size_t stage = 0; stage < std::size(kStages); ++stage)
        if (const float ms = rows.row(i)[stage]; !std::isnan(ms))
          (times.*kStages[stage]).push_back(static_cast<double>(ms));
  } catch (const InputError& error) {
    if (!options_.quiet)
      std::cerr << "note: " << error.what() << "; the times of describing are not known\n";
  }
  return times;
}

/// Their similarity to anything means nothing.
void LazyFeatures::warn_of_zeros(const pipeline::FeatureFile& features) {
  int64_t zeros = 0;
  for (int64_t i = 0; i < features.n(); ++i) {
    const auto row = features.row(i);
    zeros += std::all_of(row.begin(), row.end(), [](float x) { return x == 0; }) ? 1 : 0;
  }
  zeros -= static_cast<int64_t>(left_out().size());  // which are said elsewhere
  if (zeros > 0)
    warn(str(zeros, " of ", features.n(), " scans have no ", source_.extractor.name,
             " (all zero): there was nothing in them that it describes"));
}

void LazyFeatures::make() {
  if (made_) return;
  Progress progress("describing", "scans", !options_.no_progress && !options_.quiet);
  describe_.progress = progress.callback();
  describe_.left_out = LeftOut(options_.quiet);
  pipeline::DescribeTimes spent =
      pipeline::write_features(paths_, source_.inputs, source_.extractor, describe_);
  made_ = true;
  describe_.progress = {};
  if (spent.read.empty()) return;  // all were there
  write_times(times_file(), spent);
  times_ = std::move(spent);
}

}  // namespace revisit::cli
