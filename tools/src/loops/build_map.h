#pragma once

#include <functional>
#include <string>
#include <vector>

#include "revisit/datasets/dataset.h"
#include "revisit/maps/place_recognizer.h"

namespace revisit::cli {

struct BuildMap {
  std::string drive;                       // its name in the map
  pipeline::SharedWork* shared = nullptr;  // of a map that other processes fill, too
  bool keep_clouds = true;
  int threads = 1;
  std::function<bool()> stop;
  std::function<void(int64_t done, int64_t of)>
      done;  // by all processes; of those not there before
  std::function<void(const std::string& why)> left_out;
};

struct Built {
  int64_t added = 0, left_out = 0;  // by this process
};

/// drive_in_map() of a recording of at least one scan. Of the scans that the map may have, the
/// first, a middle and the last one are compared.
std::string drive_of_recording(const std::vector<pipeline::ScanRef>& scans,
                               pipeline::PlaceRecognizer& recognizer, const std::string& name);

/// Adds the scans that the recogniser's map lacks, together with all others that share the
/// work, and returns when none is missing. A scan that cannot be read or described gets no place.
/// Throws what PlaceRecognizer does, Interrupted.
Built build_map(const std::vector<pipeline::ScanRef>& scans, pipeline::PlaceRecognizer& recognizer,
                const BuildMap& options);

}  // namespace revisit::cli
