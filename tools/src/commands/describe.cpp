#include <iostream>
#include <numbers>

#include "cli/command.h"
#include "cli/json.h"
#include "cli/table.h"
#include "eval/config_file.h"
#include "eval/eval_options.h"
#include "eval/points_outside.h"
#include "eval/run_info.h"
#include "eval/summary_table.h"
#include "revisit/base/files.h"
#include "revisit/datasets/observer.h"
#include "revisit/proto/npy.h"

namespace revisit::cli {
namespace {

namespace fs = std::filesystem;

void write_frames(const fs::path& file, const Dataset& dataset,
                  const std::vector<AlignmentRecord>& alignments) {
  Table table({"row", "frame", "file", "time", "yaw_deg", "eigenvalue_ratio", "abs_t11",
               "mirrored_choice", "outside", "described"});
  for (size_t i = 0; i < dataset.scans.size(); ++i) {
    const ScanRef& scan = dataset.scans[i];
    const AlignmentRecord& a = alignments[i];
    table.row({str(i), str(scan.frame), scan.file.string(), scan.time ? number(*scan.time, 6) : "",
               number(a.yaw * 180 / std::numbers::pi, 3), number(a.eigenvalue_ratio, 4),
               number(a.abs_t11, 4), number(a.mirrored_choice, 0), number(a.outside, 4),
               number(a.described, 0)});
  }
  write_atomically(file, [&](std::ostream& out) { table.print_csv(out); });
}

struct DescribeCommand {
  FeatureOptions feature;
  fs::path output;

  void declare(Options& options) {
    feature.declare(options);
    options.group("Output:");
    options.option("output", "DIR", "folder of the descriptors", &output, 'o').required().common();
    std::vector<std::string> of_eval;  // keys of config.yaml
    for (const auto& [name, value] : settings_of({})) of_eval.push_back(name);
    options.config(read_config_file, of_eval);
  }
};

int run_describe(DescribeCommand& o) {
  if (o.feature.fitted_on() == "map")
    throw UsageError("--fit-on map: needs stored scans, which only `revisit eval` has");

  const Dataset dataset = open_scans(o.feature);
  const Observer observer = o.feature.observer();
  if (const std::string found = resolve_sensor(o.feature, dataset); !found.empty())
    observer.note("sensor: " + found);
  make_folder(o.output);  // first, because describing may take hours
  const fs::path cache = o.feature.cache_folder(o.output);
  const FeatureSource source = open_feature(o.feature, dataset, cache);
  DatasetFeatures features(source.inputs, source.extractor, o.feature.describe(source), cache,
                           observer);
  std::vector<std::string> skipped;
  for (const int64_t row : features.skipped())
    skipped.push_back(dataset.scans[static_cast<size_t>(row)].file.filename().string());
  features.file();  // described here, so that the time of the reduction is separate
  warn_of_points_outside(o.feature, source.inputs, features.alignments());
  EvaluationTimes times;
  times.describe = features.times();

  const bool fits = o.feature.fitted_on() == "all";
  Stopwatch watch;
  const Descriptors descriptors = reduce(o.feature.reduction(source), {}, features, nullptr,
                                         observer, fits ? o.output / "pca" : fs::path());
  times.reduce.push_back(watch.lap());
  if (!descriptors.note.empty()) observer.note(descriptors.note);
  const FloatMatrix& matrix = descriptors.case1;
  proto::write_npy(o.output / "descriptors.npy", {matrix.n, matrix.d}, matrix.values.data());
  write_frames(o.output / "frames.csv", dataset, features.alignments());
  write_json(o.output / "run.json", run_info(o.feature, dataset, source, descriptors.pca_fit, times,
                                             features.alignments()));
  std::cout << matrix.n << " scans, feature " << source.extractor.name << " ("
            << source.extractor.dim << " dimensions), PCA " << descriptors.pca_fit << "\n"
            << "descriptors: " << (o.output / "descriptors.npy").string() << "\n";
  print_skipped(std::cout, skipped, matrix.n);
  std::cout << "\n";
  print_times(times, std::cout);
  return skipped.empty() ? kOk : kScansSkipped;
}

}  // namespace

Command describe_command() {
  return {"describe", "compute the descriptors of scans",
          "Computes a descriptor for every scan of a KITTI sequence or a folder of .bin, .pcd or "
          ".ply files: DIR/descriptors.npy [scans][K], DIR/frames.csv (the scan of each row), "
          "DIR/run.json (options and times) and DIR/pca (mean.npy, basis.npy, for --pca). If "
          "interrupted, run the same command again to resume.",
          "  revisit describe scans/ -o out                                   # ring descriptors\n"
          "  revisit describe KITTI --sequence 00 --model bvlc_alexnet --end conv3 --graft pool5 "
          "-o out\n"
          "  revisit describe scans/ --sensor vlp16 --feature data --pca 100 -o out\n"
          "  revisit describe KITTI --sequence 05 --feature cnn --pca out/pca -o out05\n",
          with_options<DescribeCommand>(run_describe)};
}

}  // namespace revisit::cli
