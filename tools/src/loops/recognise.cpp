#include "recognise.h"

#include <unordered_map>

#include "cli/messages.h"
#include "loops/describe_scan.h"
#include "loops/recent_places.h"
#include "revisit/base/error.h"
#include "revisit/datasets/scan_file.h"
#include "revisit/datasets/stopwatch.h"

namespace revisit::cli {
namespace {

using pipeline::PreparedScan;
using pipeline::ScanRef;

/// The scans of a drive by their positions in the recogniser, read again to be registered.
class Files {
 public:
  void remember(int64_t position, const std::filesystem::path& file) { files_[position] = file; }
  /// Nothing for a place whose scan is not at hand: of another drive, or gone meanwhile.
  std::optional<PreparedScan> prepared(int64_t position) const {
    const auto file = files_.find(position);
    if (file == files_.end()) return std::nullopt;
    try {
      return PreparedScan(pipeline::read_scan(file->second));
    } catch (const InputError& error) {
      warn(str(error.what(), "; the loop is not registered"));
      return std::nullopt;
    }
  }

 private:
  std::unordered_map<int64_t, std::filesystem::path> files_;
};

}  // namespace

void recognise(const ScanStream& next, pipeline::PlaceRecognizer& recognizer,
               const Recognise& options, const std::function<void(const Visit&)>& visit) {
  RecentPlaces recent(options.exclusion);
  Files files;
  pipeline::PointCloud cloud;
  while (const std::optional<ScanRef> scan = next()) {
    if (options.stop()) throw Interrupted("stopped; what was found is kept");
    Visit seen;
    seen.drive = options.drive;
    seen.scan = *scan;
    const std::span<const int64_t> without = recent.at(*scan);

    DescribedScan described = describe_scan(*scan, options.drive, recognizer, cloud);
    if (!described.description.described()) {
      seen.why_not = described.description.why_not;
      visit(seen);
      continue;
    }
    pipeline::Stopwatch watch;
    recognizer.refresh_on_news();
    seen.loop = recognizer.query(described.description, without);
    const int64_t position = recognizer.add(described.description, std::move(described.place));
    seen.position = position;
    seen.milliseconds = described.milliseconds + watch.lap();
    recent.add(position);
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
