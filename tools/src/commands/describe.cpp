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
#include "revisit/base/atomic_file.h"
#include "revisit/base/folder.h"
#include "revisit/datasets/stopwatch.h"
#include "revisit/proto/npy.h"

namespace revisit::cli {
namespace {

namespace fs = std::filesystem;

/// Row, frame and alignment of each descriptor, so that descriptors.npy can be used alone.
void write_frames(const fs::path& file, const pipeline::Dataset& dataset,
                  const std::vector<pipeline::AlignmentRecord>& alignments) {
  Table table({"row", "frame", "file", "time", "yaw_deg", "eigenvalue_ratio", "abs_t11",
               "mirrored_choice", "outside", "described"});
  for (size_t i = 0; i < dataset.scans.size(); ++i) {
    const pipeline::ScanRef& scan = dataset.scans[i];
    const pipeline::AlignmentRecord& a = alignments[i];
    table.row({str(i), str(scan.frame), scan.file.string(), scan.time ? number(*scan.time, 6) : "",
               number(a.yaw * 180 / std::numbers::pi, 3), number(a.eigenvalue_ratio, 4),
               number(a.abs_t11, 4), number(a.mirrored_choice, 0), number(a.outside, 4),
               number(a.described, 0)});
  }
  write_atomically(file, [&](std::ostream& out) { table.print_csv(out); });
}

}  // namespace

int describe_command(const Arguments& arguments) {
  if (lists_sensors(arguments)) return kOk;
  FeatureOptions options;
  fs::path output;
  Parser parser(
      "revisit describe", "DATA -o DIR",
      "Turn every scan of a KITTI sequence or a folder of .bin, .pcd or .ply files into a "
      "descriptor: DIR/descriptors.npy [scans][K], DIR/frames.csv (which row is which scan), "
      "DIR/run.json (how it was made and the time of each stage) and DIR/pca (mean.npy, basis.npy: "
      "for --fit-on elsewhere). Run the same command again to continue a stopped run.",
      "  revisit describe KITTI --sequence 00 -o out\n"
      "  revisit describe scans/ --sensor vlp16 --feature data --pca 100 -o out\n"
      "  revisit describe KITTI --sequence 05 --fit-on out/pca -o out05\n");
  options.declare(parser);
  parser.group("Output:");
  parser.option("output", "DIR", "folder for the descriptors", &output, 'o');
  std::vector<std::string> of_eval;  // in the config.yaml of a run
  for (const auto& [name, value] : settings_of({})) of_eval.push_back(name);
  parser.config(read_config_file, of_eval);
  parser.parse(arguments);
  options.check_given(parser);
  if (output.empty()) throw UsageError("give the folder for the descriptors: -o DIR");
  if (options.fit_on == "map")
    throw UsageError("--fit-on map needs a task with stored scans: use `revisit eval`");

  const pipeline::Dataset dataset = open_scans(options);
  const pipeline::Observer observer = options.observer();
  if (const std::string found = resolve_sensor(options, dataset); !found.empty())
    observer.note("sensor: " + found);
  make_folder(output);  // now, as describing may take hours
  const fs::path cache = options.cache_folder(output);
  const FeatureSource source = open_feature(options, dataset, cache);
  pipeline::DatasetFeatures features(source.inputs, source.extractor, options.describe(source),
                                     cache, observer);
  std::vector<std::string> left_out;
  for (const int64_t row : features.left_out())
    left_out.push_back(dataset.scans[static_cast<size_t>(row)].file.filename().string());
  features.file();  // so that the time of the reduction is its own
  warn_of_points_outside(options, source.inputs, features.alignments());
  pipeline::EvaluationTimes times;
  times.describe = features.times();

  const bool fits = options.fit_on == "all";
  pipeline::Stopwatch watch;
  const pipeline::Descriptors descriptors =
      pipeline::reduce(options.reduction(source), {}, features, nullptr, observer,
                       fits ? output / "pca" : fs::path());
  times.reduce.push_back(watch.lap());
  if (!descriptors.note.empty()) observer.note(descriptors.note);
  const pipeline::FloatMatrix& matrix = descriptors.case1;
  proto::write_npy(output / "descriptors.npy", {matrix.n, matrix.d}, matrix.values.data());
  write_frames(output / "frames.csv", dataset, features.alignments());
  write_json(output / "run.json",
             run_info(options, dataset, source, descriptors.pca_fit, times, features.alignments()));
  std::cout << matrix.n << " scans, feature " << source.extractor.name << " ("
            << source.extractor.dim << " numbers), PCA " << descriptors.pca_fit << "\n"
            << "descriptors: " << (output / "descriptors.npy").string() << "\n";
  print_left_out(std::cout, left_out, matrix.n);
  std::cout << "\n";
  print_times(times, std::cout);
  return left_out.empty() ? kOk : kScansLeftOut;
}

}  // namespace revisit::cli
