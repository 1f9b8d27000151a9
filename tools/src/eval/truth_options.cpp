#include "eval/truth_options.h"

#include <algorithm>

#include "revisit/base/text.h"

namespace revisit::cli {
namespace {

namespace fs = std::filesystem;

void read_all(const std::string& files, const Dataset& dataset, int near,
              ListedPairs::Places& pairs) {
  for (const std::string& file : comma_separated(files))
    for (const auto& [query, places] : read_pairs(file, dataset, near))
      pairs[query].insert(places.begin(), places.end());
}

}  // namespace

void TruthOptions::declare(Options& options) {
  poses.declare(options);
  options.group("Pairs:")
      .option("pairs", "FILE[,FILE]",
              "ground truth without poses: lines `query,place`, by frame or file name "
              "(first/000032 if DATA has folders, which are one recording in the order of their "
              "names); an empty place: no true match. Other pairs are false",
              &pairs)
      .common()
      .excludes({"distance", "radius", "negative-radius"})
      .option("pairs-near", "N", "tolerance in frames around a listed place (default 0)",
              &pairs_near)
      .needs("pairs")
      .at_least(0)
      .flag("pairs-complete",
            "no true match for queries that are not listed (default: they are not queries)",
            &pairs_complete)
      .needs("pairs")
      .option("pairs-ignore", "FILE[,FILE]", "pairs that are neither true nor false", &pairs_ignore)
      .needs("pairs");
}

Dataset TruthOptions::open(const FeatureOptions& data, bool needs_poses) const {
  Dataset dataset = open_scans(data, needs_poses && !has_own());
  if (!poses.file.empty()) dataset.scans = poses.scans_of(dataset);
  return dataset;
}

std::optional<ListedPairs> TruthOptions::listed(const FeatureOptions& data) const {
  if (pairs.empty()) return std::nullopt;
  const Dataset whole = open_dataset(data.data, data.sequence);
  ListedPairs listed;
  listed.complete = pairs_complete;
  read_all(pairs, whole, pairs_near, listed.correct);
  read_all(pairs_ignore, whole, pairs_near, listed.ignored);
  return listed;
}

std::string listed_but_not_asked(const ListedPairs& listed, const TaskResult& result) {
  const auto with_place =
      std::ranges::count_if(listed.correct, [](const auto& pair) { return !pair.second.empty(); });
  const int64_t lost = with_place - result.summary.n_positives;
  if (lost <= 0) return "";
  return str(result.task.name, ": ", lost, " of ", with_place,
             " listed queries cannot find their place, because a scan is no query or not stored, "
             "or within the "
             "exclusion, or the place comes later");
}

}  // namespace revisit::cli
