#include <algorithm>
#include <array>
#include <chrono>
#include <iostream>
#include <map>
#include <thread>

#include "cli/command.h"
#include "cli/terminal.h"
#include "loops/map_source.h"
#include "loops/recognize.h"
#include "loops/virtual_scans.h"
#include "revisit/engine/parallel_for.h"
#include "revisit/loops/loop_detector.h"
#include "revisit/maps/map_store.h"
#include "revisit/recognition/align.h"
#include "revisit/registration/registration.h"

namespace revisit::cli {
namespace {

/// Per thread and transaction. More mean fewer transactions, and more lost work if a process dies.
constexpr int64_t kScansAtOnce = 8;
/// Interval of looking for scans that other processes claimed but did not add.
constexpr std::chrono::milliseconds kOthersAtWork{250};

struct BuildOptions {
  FeatureOptions feature;
  MapArguments map;
  bool from_cloud = false;
  std::filesystem::path trajectory;

  void declare(Options& options) {
    feature.declare(options, Scans::kStored);
    map.declare(options);
    options.group("Cloud of a site:")
        .flag("from-cloud",
              "DATA is a cloud of a site with z up (.pcd, .ply, .las, .laz): scans of the sensor "
              "are rendered from its points, 4 m apart on the free floor or along --poses",
              &from_cloud)
        .common()
        .option("poses", "FILE",
                "trajectory of the sensor in the frame of the cloud (x forward, y left, z up)",
                &trajectory)
        .needs("from-cloud");
    options.check([this] {
      if (from_cloud && feature.image.is_auto()) feature.image.sensor = "hdl64";
      if (map.file.empty()) throw UsageError("missing required option --map FILE");
    });
  }
};

/// drive_in_map() of a recording of at least one scan. Compares the first, a middle and the last of
/// the scans that the map may have.
std::string drive_of_recording(const std::vector<ScanRef>& scans, Map& map,
                               const std::string& name) {
  PointCloud first, cloud;
  for (size_t i = 0; i < scans.size() && first.points.empty(); ++i)
    describe_scan(scans[i], name, map, first);
  return drive_in_map(map, name, view_of(first), [&](const DriveEntries& entries) {
    std::vector<const ScanRef*> common;
    for (const ScanRef& scan : scans)
      if (entries.contains(scan.frame)) common.push_back(&scan);
    if (common.empty()) return may_belong_to(entries, scans.front().frame);
    // Two recordings may begin alike, so later scans count, too.
    return std::ranges::all_of(
        std::array{size_t{0}, common.size() / 2, common.size() - 1}, [&](size_t at) {
          const DescribedScan scan = describe_scan(*common[at], name, map, cloud);
          return !scan.description.described() ||
                 is_same_scan(map, scan.description, scan.entry.time,
                              entries.at(common[at]->frame));
        });
  });
}

/// Describes the scans of a drive that the map lacks and adds them.
class MapBuilder {
 public:
  MapBuilder(const BuildOptions& options, const std::vector<ScanRef>& scans, Map& map,
             std::string drive)
      : threads_(options.feature.thread_count()),
        keeps_clouds_(!options.map.no_clouds),
        map_(map),
        mount_(map.options().mount),
        drive_(std::move(drive)),
        progress_("describing", "scans", !options.feature.quiet) {
    for (const ScanRef& scan : scans) missing_[scan.frame] = &scan;
    map_.add({});  // ends a warm-up of a killed process
  }

  int64_t added() const { return added_; }
  int64_t skipped() const { return skipped_; }

  /// Returns when no scan is missing, also of the other processes that share the work.
  void add_missing() {
    drop_stored();
    const auto all = std::ssize(missing_);
    while (!missing_.empty()) {
      progress_.update(all - std::ssize(missing_), all);
      stop_if_interrupted();
      const std::vector<int64_t> claimed = claim();
      try {
        if (!claimed.empty())
          describe_and_add(claimed);
        else if (!missing_.empty())  // others have claimed them
          std::this_thread::sleep_for(kOthersAtWork);
      } catch (const ClaimLost&) {  // other processes have it, or this one again
      }
    }
    progress_.update(all, all);
  }

 private:
  int64_t at_once() const { return kScansAtOnce * threads_; }

  static void stop_if_interrupted() {
    if (interrupted())
      throw Interrupted(
          "interrupted; the map keeps what was added; run the same command again to resume");
  }

  void drop_stored() {
    map_.refresh();
    for (const auto& [frame, index] : map_.entries_of(drive_)) missing_.erase(frame);
  }

  std::vector<int64_t> claim() {
    std::vector<int64_t> frames, claimed;
    for (const auto& [frame, scan] : missing_) frames.push_back(frame);
    map_.use_store([&](MapStore& map) { claimed = map.claim(drive_, frames, at_once()); });
    drop_stored();
    std::erase_if(claimed, [&](int64_t frame) { return !missing_.contains(frame); });
    return claimed;
  }

  DescribedScan describe(const ScanRef& scan) const {
    PointCloud cloud;
    DescribedScan described = describe_scan(scan, drive_, map_, cloud);
    if (!keeps_clouds_ || !described.description.described()) return described;
    transform(mount_, cloud);
    described.entry.cloud = compact_cloud(cloud, mount_);
    return described;
  }

  void describe_and_add(std::span<const int64_t> frames) {
    std::vector<const ScanRef*> scans;
    for (const int64_t frame : frames) scans.push_back(missing_.at(frame));
    std::vector<DescribedScan> described(scans.size());
    parallel_for(std::ssize(scans), threads_, [&](int64_t i) {
      described[static_cast<size_t>(i)] = describe(*scans[static_cast<size_t>(i)]);
    });
    std::vector<MapEntry> entries;
    std::vector<std::string> skipped;
    for (DescribedScan& scan : described) {
      if (!scan.description.described()) {
        skipped.push_back(scan.description.error);
        continue;
      }
      scan.entry.feature = std::move(scan.description.feature);
      entries.push_back(std::move(scan.entry));
    }
    added_ += std::ssize(map_.add(std::move(entries)));
    skipped_ += std::ssize(skipped);
    for (const std::string& why : skipped) warn_skipped(why);
    for (const int64_t frame : frames) missing_.erase(frame);
  }

  const int threads_;
  const bool keeps_clouds_;
  Map& map_;
  const Eigen::Isometry3d mount_;
  const std::string drive_;
  Progress progress_;
  std::map<int64_t, const ScanRef*> missing_;  // by frame
  int64_t added_ = 0, skipped_ = 0;            // by this process
};

int build_all(BuildOptions& o) {
  const Dataset dataset =
      o.from_cloud ? virtual_scans(o.feature, o.trajectory) : open_scans(o.feature);
  MapSource source = map_source(o.feature, dataset, feature_key_of(o.map.file), ScansAtOnce::kMany);
  source.options.warmup = o.map.warmup;
  const NewMap new_map(o.map.file);
  Map map(source.extractor, source.options, o.map.open(source), warn);
  const std::vector<ScanRef> scans = o.from_cloud ? dataset.scans : with_sensor_poses(dataset);
  const std::string name = o.map.drive_of(dataset), drive = drive_of_recording(scans, map, name);
  if (drive != name && !o.feature.quiet)
    note(str("the map has another recording '", name, "'; this one is stored as '", drive, "'"));
  MapBuilder builder(o, scans, map, drive);
  builder.add_missing();
  if (!o.feature.quiet)
    std::cout << display_name(o.map.file) << ": " << map.size() << " entries, " << builder.added()
              << " added by this process"
              << (builder.skipped() > 0 ? str(", ", plural(builder.skipped(), "scan"), " skipped")
                                        : "")
              << "\n";
  return builder.skipped() > 0 ? kScansSkipped : kOk;
}

}  // namespace

Command map_build_command() {
  return {"build", "describe a data set and add it to a map",
          "Describes the scans that a map lacks and adds them. Any number of processes and "
          "machines can fill a map on a server together: each claims some scans at a time, and the "
          "others take over the claims of a process that ends. If interrupted, run the same "
          "command again to resume.",
          "  revisit map build town --map town.map\n"
          "  revisit map build --from-cloud site.pcd --map site.map --sensor vlp16\n"
          "  revisit map build town --map 'postgresql://robot@server/maps?map=town'\n",
          with_options<BuildOptions>(build_all)};
}

}  // namespace revisit::cli
