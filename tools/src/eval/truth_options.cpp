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

void TruthOptions::declare(Parser& parser) {
  poses.declare(parser);
  parser.group("Pairs:")
      .option("pairs", "FILE[,FILE]",
              "ground truth without poses: lines `query,place`, by frame or file name "
              "(first/000032 if DATA has "
              "folders, which are one recording in the order of their names); an empty place: no "
              "true match. Other "
              "pairs are false",
              &pairs)
      .option("pairs-near", "N", "tolerance in frames around a listed place (default 0)",
              &pairs_near)
      .flag("pairs-complete",
            "no true match for queries that are not listed (default: they are not queries)",
            &pairs_complete)
      .option("pairs-ignore", "FILE[,FILE]", "pairs that are neither true nor false",
              &pairs_ignore);
}

void TruthOptions::check(const Parser& parser) const {
  poses.check(parser);
  for (const char* option : {"pairs-near", "pairs-complete", "pairs-ignore"})
    if (pairs.empty() && parser.given(option)) throw UsageError("--", option, ": needs --pairs");
  for (const char* option : {"distance", "radius", "negative-radius"})
    if (!pairs.empty() && parser.given(option))
      throw UsageError("--", option, ": not with --pairs, which holds no distances");
  if (pairs_near < 0)
    throw UsageError("--pairs-near: expected at least 0 frames, found ", pairs_near);
}

Dataset TruthOptions::open(const FeatureOptions& data, const DatasetNeeds& needs) const {
  Dataset dataset = open_scans(data, {.poses = needs.poses && !has_own()});
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

std::vector<std::pair<std::string, std::string>> TruthOptions::settings() const {
  const auto all = [](const std::string& files) {
    return joined(comma_separated(files), ",", placed);
  };
  const bool listed = !pairs.empty(), from_file = !poses.file.empty();
  const auto word = [](const auto& choice, std::initializer_list<const char*> words) {
    return choice ? std::string(words.begin()[static_cast<size_t>(*choice)]) : "";
  };
  return {{"pairs", all(pairs)},
          {"pairs-near", listed && pairs_near > 0 ? str(pairs_near) : ""},
          {"pairs-complete", listed && pairs_complete ? "true" : ""},
          {"pairs-ignore", all(pairs_ignore)},
          {"poses", from_file ? placed(poses.file) : ""},
          {"pose-format", word(poses.format, {"kitti", "tum", "euroc"})},
          {"pose-frame", word(poses.frame, {"lidar", "camera"})},
          {"calib", poses.calib.empty() ? "" : placed(poses.calib)},
          {"max-gap", from_file ? exact(poses.max_gap) : ""}};
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

std::string placed(const fs::path& given) {
  std::error_code none;
  return fs::exists(given, none) ? fs::absolute(given).string() : given.string();
}

}  // namespace revisit::cli
