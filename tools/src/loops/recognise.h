#pragma once

#include <functional>
#include <optional>
#include <string>

#include "loops/scan_stream.h"
#include "revisit/evaluation/ground_truth.h"
#include "revisit/maps/place_recognizer.h"
#include "revisit/registration/registration.h"

namespace revisit::cli {

/// What became of one scan.
struct Visit {
  std::string drive;
  pipeline::ScanRef scan;
  std::optional<int64_t> position;     // in the recogniser; nothing for one not described
  std::optional<pipeline::Loop> loop;  // the place most like it
  std::optional<pipeline::Registration> registered;
  std::string why_not;      // described
  double milliseconds = 0;  // from the points in memory to the answer, and until it is added
};

struct Recognise {
  std::string drive;              // the name of this one in the map
  pipeline::Exclusion exclusion;  // of its own scans of the same moment
  bool verify = false;  // accepted loops are registered; those that do not fit are not accepted
  std::function<bool()> stop = [] { return false; };
};

/// Takes every scan of the stream: describes it, asks for the place most like it, adds it, and
/// hands it to `visit`; a scan that cannot be read or described, too. Throws what PlaceRecognizer
/// does, UsageError for an exclusion that the scans know nothing of, Interrupted.
void recognise(const ScanStream& next, pipeline::PlaceRecognizer& recognizer,
               const Recognise& options, const std::function<void(const Visit&)>& visit);

}  // namespace revisit::cli
