#include "build_map.h"

#include <chrono>
#include <thread>
#include <unordered_map>

#include "loops/describe_scan.h"
#include "revisit/base/error.h"
#include "revisit/engine/parallel_for.h"

namespace revisit::cli {
namespace {

using pipeline::Description;
using pipeline::ScanRef;

/// Scans of a claim for each thread: the more, the fewer steps of the map, and the more is lost
/// with a process.
constexpr int64_t kScansAtOnce = 8;
/// Others have the last scans: when one of them ends before it has added its own, they come back.
constexpr std::chrono::milliseconds kOthersAtWork{250};
constexpr std::chrono::seconds kBetweenCounts{1};

using ByFrame = std::unordered_map<int64_t, const ScanRef*>;

const ScanRef* scan_of(int64_t frame, const ByFrame& by_frame, const BuildMap& options) {
  const auto found = by_frame.find(frame);
  if (found == by_frame.end())
    throw InputError(str("the map expects frame ", frame, " of drive '", options.drive,
                         "', which is not among these scans: give the data that the others have, "
                         "or another name for this drive"));
  return found->second;
}

}  // namespace

Built build_map(const std::vector<ScanRef>& scans, pipeline::PlaceRecognizer& recognizer,
                const BuildMap& options) {
  ByFrame by_frame;
  std::vector<int64_t> frames;
  for (const ScanRef& scan : scans) {
    by_frame[scan.frame] = &scan;
    frames.push_back(scan.frame);
  }
  recognizer.expect(options.drive, frames);
  const int64_t missing = recognizer.expected(options.drive);
  Built built;
  using Clock = std::chrono::steady_clock;
  Clock::time_point next_count;  // counting takes longer the more is left: now and then is enough
  while (true) {
    if (Clock::now() >= next_count) {
      const int64_t left = recognizer.expected(options.drive);
      options.done(missing - left, missing);
      if (left == 0) return built;
      next_count = Clock::now() + kBetweenCounts;
    }
    if (options.stop())
      throw Interrupted("stopped; what was added is kept; the same command goes on");
    try {
      const auto claim = recognizer.claim(options.drive, kScansAtOnce * options.threads);
      if (claim == nullptr) {  // all is done, or in the hands of others
        if (recognizer.expected(options.drive) > 0) std::this_thread::sleep_for(kOthersAtWork);
        next_count = {};
        continue;
      }
      std::vector<const ScanRef*> claimed;
      for (const int64_t frame : claim->frames)
        claimed.push_back(scan_of(frame, by_frame, options));
      std::vector<DescribedScan> described(claimed.size());
      parallel_for(static_cast<int64_t>(claimed.size()), options.threads, [&](int64_t i) {
        pipeline::PointCloud cloud;
        described[static_cast<size_t>(i)] =
            describe_scan(*claimed[static_cast<size_t>(i)], options.drive, recognizer, cloud);
      });
      std::vector<Description> good;
      std::vector<pipeline::StoredPlace> places;
      for (size_t i = 0; i < claimed.size(); ++i) {
        Description& description = described[i].description;
        if (!description.described()) {
          claim->left_out[claimed[i]->frame] = description.why_not;
          continue;
        }
        places.push_back(std::move(described[i].place));
        good.push_back(std::move(description));
      }
      recognizer.add(good, std::move(places), *claim);
      built.added += static_cast<int64_t>(good.size());
      for (const auto& [frame, why] : claim->left_out) {
        ++built.left_out;
        options.left_out(why);
      }
    } catch (const pipeline::ClaimLost&) {  // others have it, or we again
    }
  }
}

}  // namespace revisit::cli
