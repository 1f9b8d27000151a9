#include <iostream>
#include <set>

#include "cli/command.h"
#include "cli/json.h"
#include "cli/messages.h"
#include "cli/options.h"
#include "cli/table.h"
#include "reports.pb.h"
#include "revisit/base/error.h"
#include "revisit/datasets/dataset.h"
#include "revisit/evaluation/ground_truth.h"

namespace revisit::cli {
namespace {

namespace fs = std::filesystem;

constexpr const char* kGtSummary =
    "Prints the ground truth of a KITTI sequence: the number of frames with a true loop, and the "
    "true pairs. A frame "
    "has a true loop if an earlier frame beyond the exclusion is within the radius. Reads only the "
    "poses; every pose is "
    "a frame.";
constexpr const char* kGtExamples =
    "  revisit gt kitti --sequence 00\n"
    "  revisit gt kitti --sequence 08 --distance box --radius 3 --exclusion meters=50\n"
    "  revisit gt kitti --sequence 05 --pairs --format csv > pairs.csv\n";

struct GtOptions {
  fs::path data;
  std::string sequence, distance = "xz", exclusion = "frames=50", format = "table";
  double radius = 5;
  bool pairs = false;

  void declare(Options& options);
};

void GtOptions::declare(Options& options) {
  options.argument("DATA", &data)
      .option("sequence", "NN", "sequence, e.g. 00", &sequence)
      .option("distance", "xz|3d|box",
              "distance of two frames: xz (horizontal), 3d, or box (largest coordinate difference) "
              "(default xz)",
              &distance)
      .option("radius", "M", "maximum distance of a true match [m] (default 5)", &radius)
      .option("exclusion", "KIND=N",
              "earlier frames that are no candidates: frames=50, seconds=30, meters=50 (driven) or "
              "none (default "
              "frames=50)",
              &exclusion)
      .flag("pairs", "list of the true pairs", &pairs)
      .choice("format", {"table", "json", "csv"}, "format of standard output (default table)",
              &format);
}

/// Finds KITTI's times, which are in the sequence's folder wherever the poses are.
std::vector<double> find_times(const fs::path& poses, const fs::path& data) {
  const fs::path folders[] = {poses.parent_path(),
                              poses.parent_path().parent_path() / "sequences" / poses.stem(), data};
  std::string looked;
  for (const fs::path& folder : folders) {
    const fs::path file = folder / "times.txt";
    if (fs::exists(file)) return read_kitti_times(file);
    looked += (looked.empty() ? "" : ", ") + file.string();
  }
  throw InputError("no time stamps for ", poses.string(), ": looked for ", looked);
}

/// "00" for poses/00.txt and for sequences/00/poses.txt.
std::string sequence_name(const fs::path& poses) {
  return poses.filename() == "poses.txt" ? fs::absolute(poses).parent_path().filename().string()
                                         : poses.stem().string();
}

/// Removes pairs of frames without a scan, which `revisit eval --pairs` rejects.
void keep_those_with_scans(const GtOptions& o, LoopTruth& truth) {
  std::set<int64_t> frames;
  try {
    for (const ScanRef& scan : open_dataset(o.data, o.sequence).scans) frames.insert(scan.frame);
  } catch (const InputError&) {  // poses alone are enough
    return;
  }
  const auto skipped = std::erase_if(truth.pairs, [&](const TruePair& pair) {
    return !frames.contains(pair.query) || !frames.contains(pair.match);
  });
  std::set<int64_t> positives;
  for (const TruePair& pair : truth.pairs) positives.insert(pair.query);
  truth.n_positives = std::ssize(positives);
  if (skipped > 0) note(str(skipped, " pairs of frames without a scan are skipped"));
}

reports::GroundTruth make_report(const std::string& sequence, const Trajectory& trajectory,
                                 const TrueMatchRule& rule, const Exclusion& exclusion,
                                 const LoopTruth& truth, bool with_pairs) {
  reports::GroundTruth report;
  report.set_sequence(sequence);
  report.set_distance(name_of(rule.distance));
  report.set_radius_m(rule.radius);
  report.set_exclusion(to_string(exclusion));
  report.set_n_frames(static_cast<int>(trajectory.size()));
  report.set_n_queries(static_cast<int>(truth.n_queries));
  report.set_n_positives(static_cast<int>(truth.n_positives));
  report.set_n_pairs(static_cast<int>(truth.pairs.size()));
  if (!with_pairs) return report;
  for (const TruePair& pair : truth.pairs) {
    reports::TruePair& item = *report.add_pairs();
    item.set_query(trajectory.frames[pair.query]);
    item.set_match(trajectory.frames[pair.match]);
    item.set_distance_m(pair.distance);
  }
  return report;
}

Table summary_table(const reports::GroundTruth& report) {
  Table table({"sequence", "distance", "radius_m", "exclusion", "n_frames", "n_queries",
               "n_positives", "n_pairs"});
  table.row({report.sequence(), report.distance(), str(report.radius_m()), report.exclusion(),
             str(report.n_frames()), str(report.n_queries()), str(report.n_positives()),
             str(report.n_pairs())});
  return table;
}

Table pair_table(const reports::GroundTruth& report) {
  Table table({"query", "match", "distance_m"});
  for (const reports::TruePair& pair : report.pairs())
    table.row({str(pair.query()), str(pair.match()), number(pair.distance_m(), 3)});
  return table;
}

void print(const reports::GroundTruth& report, const GtOptions& o) {
  if (o.pairs && o.format == "table") {
    summary_table(report).print(std::cout);
    std::cout << "\n";
  }
  print_report(o.format, report, o.pairs ? pair_table(report) : summary_table(report));
}

int print_truth(const GtOptions& o) {
  const TrueMatchRule rule{parse_distance(o.distance), o.radius};
  const Exclusion exclusion = parse_exclusion(o.exclusion);
  const fs::path file = find_kitti_poses(o.data, o.sequence);
  const std::vector<double> times = exclusion.kind == Exclusion::Kind::kSeconds
                                        ? find_times(file, o.data)
                                        : std::vector<double>();
  const Trajectory trajectory = make_trajectory(read_kitti_poses(file), times);
  LoopTruth truth = find_loops(trajectory, rule, exclusion);
  if (o.pairs) keep_those_with_scans(o, truth);
  print(make_report(o.sequence.empty() ? sequence_name(file) : o.sequence, trajectory, rule,
                    exclusion, truth, o.pairs),
        o);
  return kOk;
}

}  // namespace

Command gt_command() {
  return {"gt", "print the ground truth: number and list of true pairs", kGtSummary, kGtExamples,
          with_options<GtOptions>(print_truth)};
}

}  // namespace revisit::cli
