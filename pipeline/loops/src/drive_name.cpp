#include "revisit/loops/drive_name.h"

#include "revisit/base/error.h"

namespace revisit::pipeline {
namespace {

/// A stored descriptor may be rounded to float16; two scans of a standing sensor are less alike.
constexpr double kSameScan = 0.9999;

}  // namespace

std::string drive_in_map(const PlaceRecognizer& recognizer, const std::string& name,
                         const Description& scan, int64_t frame) {
  const auto is_another = [&](const std::string& drive) {
    const auto places = recognizer.places_of(drive);
    const auto there = places.find(frame);
    return there != places.end() && recognizer.similarity(scan, there->second) < kSameScan;
  };
  std::string drive = name;
  for (int number = 2; is_another(drive); ++number) drive = str(name, "-", number);
  return drive;
}

}  // namespace revisit::pipeline
