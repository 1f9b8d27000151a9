#include "build_map.h"

#include <algorithm>
#include <array>
#include <chrono>
#include <map>
#include <thread>

#include "loops/describe_scan.h"
#include "revisit/base/error.h"
#include "revisit/engine/parallel_for.h"
#include "revisit/loops/drive_name.h"
#include "revisit/recognition/align.h"
#include "revisit/registration/registration.h"

namespace revisit::cli {
namespace {

/// Per thread and transaction. More mean fewer transactions, and more lost work if a process dies.
constexpr int64_t kScansAtOnce = 8;
/// Interval of looking for scans that other processes claimed but did not add.
constexpr std::chrono::milliseconds kOthersAtWork{250};
constexpr std::chrono::seconds kBetweenCounts{1};

using ByFrame = std::map<int64_t, const ScanRef*>;

const ScanRef& scan_of(int64_t frame, const ByFrame& by_frame, const BuildMap& options) {
  const auto found = by_frame.find(frame);
  if (found == by_frame.end())
    throw InputError(
        "frame ", frame, " of drive '", options.drive,
        "', which the map expects, is not among these scans; give the data of the other "
        "processes, or another --drive");
  return *found->second;
}

void stop_if_interrupted(const BuildMap& options) {
  if (options.stop())
    throw Interrupted(
        "interrupted; the map keeps what was added; run the same command again to resume");
}

/// `frames`: those of `claim` unless it is null.
void describe_and_add(std::span<const int64_t> frames, const ByFrame& by_frame,
                      PlaceRecognizer& recognizer, const BuildMap& options, Claim* claim,
                      Built& built) {
  std::vector<const ScanRef*> scans;
  for (const int64_t frame : frames) scans.push_back(&scan_of(frame, by_frame, options));
  std::vector<DescribedScan> described(scans.size());
  parallel_for(std::ssize(scans), options.threads, [&](int64_t i) {
    PointCloud cloud;
    described[static_cast<size_t>(i)] =
        describe_scan(*scans[static_cast<size_t>(i)], options.drive, recognizer, cloud);
    if (!options.keep_clouds || !described[static_cast<size_t>(i)].description.described()) return;
    transform(recognizer.mount(), cloud);
    described[static_cast<size_t>(i)].entry.cloud = compact_cloud(cloud, recognizer.mount());
  });
  std::vector<Description> good;
  std::vector<MapEntry> entries;
  std::map<int64_t, std::string> skipped;
  for (DescribedScan& scan : described) {
    if (!scan.description.described()) {
      skipped[scan.entry.frame] = scan.description.error;
      continue;
    }
    entries.push_back(std::move(scan.entry));
    good.push_back(std::move(scan.description));
  }
  if (claim != nullptr) claim->skipped = skipped;
  recognizer.add(good, std::move(entries), claim);
  built.added += std::ssize(good);
  built.skipped += std::ssize(skipped);
  for (const auto& [frame, why] : skipped) options.skipped(why);
}

}  // namespace

std::string drive_of_recording(const std::vector<ScanRef>& scans, PlaceRecognizer& recognizer,
                               const std::string& name) {
  PointCloud first, cloud;
  for (size_t i = 0; i < scans.size() && first.points.empty(); ++i)
    describe_scan(scans[i], name, recognizer, first);
  return drive_in_map(recognizer, name, view_of(first), [&](const DriveEntries& entries) {
    std::vector<const ScanRef*> common;
    for (const ScanRef& scan : scans)
      if (entries.contains(scan.frame)) common.push_back(&scan);
    if (common.empty()) return may_belong_to(entries, scans.front().frame);
    // Two recordings may begin alike, so later scans count, too.
    return std::ranges::all_of(
        std::array{size_t{0}, common.size() / 2, common.size() - 1}, [&](size_t at) {
          const DescribedScan scan = describe_scan(*common[at], name, recognizer, cloud);
          return !scan.description.described() ||
                 is_same_scan(recognizer, scan.description, scan.entry.time,
                              entries.at(common[at]->frame));
        });
  });
}

Built build_map(const std::vector<ScanRef>& scans, PlaceRecognizer& recognizer,
                const BuildMap& options) {
  ByFrame by_frame;
  for (const ScanRef& scan : scans) by_frame[scan.frame] = &scan;
  std::vector<int64_t> frames;
  for (const auto& [frame, scan] : by_frame) frames.push_back(frame);
  // Ends a warm-up in which a process was killed.
  recognizer.add(std::span<const Description>(), {});
  const int64_t at_once = kScansAtOnce * options.threads;
  Built built;
  if (options.shared == nullptr) {
    const std::map<int64_t, int64_t> there = recognizer.entries_of(options.drive);
    std::erase_if(frames, [&](int64_t frame) { return there.contains(frame); });
    const auto all = std::ssize(frames);
    for (int64_t done = 0; done < all; done += at_once) {
      options.done(done, all);
      stop_if_interrupted(options);
      const auto n = static_cast<size_t>(std::min(at_once, all - done));
      describe_and_add(std::span(frames).subspan(static_cast<size_t>(done), n), by_frame,
                       recognizer, options, nullptr, built);
    }
    options.done(all, all);
    return built;
  }

  WorkQueue& work = *options.shared;
  work.enqueue(options.drive, frames);
  const int64_t missing = work.pending(options.drive);
  using Clock = std::chrono::steady_clock;
  Clock::time_point next_count;  // counting is slow while much is pending
  while (true) {
    if (Clock::now() >= next_count) {
      const int64_t left = work.pending(options.drive);
      options.done(missing - left, missing);
      if (left == 0) return built;
      next_count = Clock::now() + kBetweenCounts;
    }
    stop_if_interrupted(options);
    try {
      if (const auto claim = work.claim(options.drive, at_once)) {
        describe_and_add(claim->frames, by_frame, recognizer, options, claim.get(), built);
        continue;
      }
      // All scans are done or claimed by others.
      if (work.pending(options.drive) > 0) std::this_thread::sleep_for(kOthersAtWork);
      next_count = {};
    } catch (const ClaimLost&) {  // other processes have it, or this one again
    }
  }
}

}  // namespace revisit::cli
