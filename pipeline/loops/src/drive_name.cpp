#include "revisit/loops/drive_name.h"

#include <map>

#include "revisit/base/error.h"

namespace revisit::pipeline {
namespace {

/// A stored descriptor may be rounded to float16; two scans of a standing sensor are less alike.
constexpr double kSameScan = 0.9999;

}  // namespace

bool is_same_scan(const PlaceRecognizer& recognizer, const Description& scan, int64_t position) {
  return recognizer.similarity(scan, position) >= kSameScan;
}

std::string drive_in_map(const PlaceRecognizer& recognizer, const std::string& name,
                         const Description& scan, int64_t frame) {
  const auto has_scan = [&](const std::map<int64_t, int64_t>& places) {
    const auto there = places.find(frame);
    return there != places.end() && is_same_scan(recognizer, scan, there->second);
  };
  const auto may_be = [&](const std::string& drive) {
    const auto places = recognizer.places_of(drive);
    return places.empty() || places.rbegin()->first < frame || has_scan(places);
  };
  if (recognizer.places_of(name).empty() && has_scan(recognizer.places_of(""))) return "";
  std::string drive = name;
  for (int number = 2; !may_be(drive); ++number) drive = str(name, "-", number);
  return drive;
}

}  // namespace revisit::pipeline
