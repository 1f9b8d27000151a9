#include "recognise.h"

#include <deque>
#include <unordered_map>

#include "revisit/datasets/scan_file.h"
#include "revisit/datasets/stopwatch.h"
#include "revisit/proto/error.h"

namespace revisit::cli {
namespace {

using pipeline::Exclusion;
using pipeline::PreparedScan;
using pipeline::ScanRef;

/// Frames, seconds or metres since the beginning of the drive.
class WayDriven {
 public:
  explicit WayDriven(Exclusion::Kind kind) : kind_(kind) {}
  double at(const ScanRef& scan) {
    if (kind_ == Exclusion::Kind::kSeconds) {
      if (!scan.time)
        throw UsageError("exclusion in seconds: the scans have no times; use frames=N");
      return *scan.time;
    }
    if (kind_ != Exclusion::Kind::kMetres) return scan.frame;
    if (!scan.pose) throw UsageError("exclusion in metres: the scans have no poses; use frames=N");
    const Eigen::Vector3d here = scan.pose->translation();
    if (moving_) driven_ += (here - last_).norm();
    moving_ = true;
    last_ = here;
    return driven_;
  }

 private:
  Exclusion::Kind kind_;
  double driven_ = 0;
  bool moving_ = false;
  Eigen::Vector3d last_ = Eigen::Vector3d::Zero();
};

/// The scans of a drive by their positions in the recogniser, read again to be registered.
class Files {
 public:
  void remember(int64_t position, const std::filesystem::path& file) { files_[position] = file; }
  /// Nothing for a place of another drive, whose scan is not at hand.
  std::optional<PreparedScan> prepared(int64_t position) const {
    const auto file = files_.find(position);
    if (file == files_.end()) return std::nullopt;
    return PreparedScan(pipeline::read_scan(file->second));
  }

 private:
  std::unordered_map<int64_t, std::filesystem::path> files_;
};

}  // namespace

void recognise(const ScanStream& next, pipeline::PlaceRecognizer& recognizer,
               const Recognise& options, const std::function<void(const Visit&)>& visit) {
  struct Recent {
    int64_t position = 0;
    double along = 0;
  };
  std::deque<Recent> recent;
  std::vector<int64_t> without;
  WayDriven driven(options.exclusion.kind);
  Files files;
  pipeline::PointCloud cloud;
  while (const std::optional<ScanRef> scan = next()) {
    if (options.stop()) throw Interrupted("stopped; what was found is kept");
    Visit seen;
    seen.drive = options.drive;
    seen.scan = *scan;
    const double along = driven.at(*scan);
    if (options.exclusion.kind == Exclusion::Kind::kNone)
      recent.clear();
    else
      while (!recent.empty() && along - recent.front().along > options.exclusion.amount)
        recent.pop_front();
    without.clear();
    for (const Recent& before : recent) without.push_back(before.position);

    pipeline::Description description;
    pipeline::Stopwatch watch;
    try {
      pipeline::read_scan_into(scan->file, cloud);
      watch.lap();
      description = recognizer.describe(view_of(cloud));
      if (!description.described()) seen.why_not = scan->file.string() + ": " + description.why_not;
    } catch (const InputError& error) {
      seen.why_not = error.what();
    }
    if (!seen.why_not.empty()) {
      visit(seen);
      continue;
    }
    recognizer.refresh_on_news();
    seen.loop = recognizer.query(description, without);
    pipeline::StoredPlace place;
    place.drive = options.drive;
    place.frame = scan->frame;
    place.time = scan->time;
    place.pose = scan->pose;
    const int64_t position = recognizer.add(description, std::move(place));
    seen.position = position;
    seen.milliseconds = watch.lap();
    recent.push_back({position, along});
    if (options.verify) {
      files.remember(position, scan->file);
      if (seen.loop && seen.loop->accepted && seen.loop->turn)
        if (const auto there = files.prepared(seen.loop->position)) {
          seen.registered = register_scans(PreparedScan(cloud), *there, *seen.loop->turn);
          seen.loop->accepted = seen.registered->accepted;
        }
    }
    visit(seen);
  }
}

}  // namespace revisit::cli
