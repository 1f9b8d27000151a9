#pragma once

#include <functional>
#include <string>
#include <vector>

#include "revisit/datasets/dataset.h"
#include "revisit/maps/place_recognizer.h"

namespace revisit::cli {

struct BuildMap {
  std::string drive;
  WorkQueue* shared = nullptr;  // for a map that other processes fill, too
  bool keep_clouds = true;
  int threads = 1;
  std::function<bool()> stop;
  std::function<void(int64_t done, int64_t of)>
      done;  // scans of all processes; `of`: those missing at the start
  std::function<void(const std::string& why)> skipped;
};

struct Built {
  int64_t added = 0, skipped = 0;  // by this process
};

/// drive_in_map() of a recording of at least one scan. Compares the first, a middle and the last of
/// the scans that the map may have.
std::string drive_of_recording(const std::vector<ScanRef>& scans, PlaceRecognizer& recognizer,
                               const std::string& name);

/// Returns when no scan is missing, also of processes that share the work. Skips scans that cannot
/// be read or described. Throws what PlaceRecognizer throws, and Interrupted.
Built build_map(const std::vector<ScanRef>& scans, PlaceRecognizer& recognizer,
                const BuildMap& options);

}  // namespace revisit::cli
