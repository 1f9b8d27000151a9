#pragma once

#include <filesystem>
#include <memory>
#include <string>

#include "cli/parser.h"
#include "loops/open_recognizer.h"

namespace revisit::cli {

/// What every command that adds places to a map takes.
struct MapOptions {
  std::filesystem::path file, basis;
  std::string drive;
  int64_t first_stretch = pipeline::RecognizerOptions().first_stretch;
  pipeline::NumberFormat numbers = pipeline::NumberFormat::kFloat32;
  bool no_clouds = false;

  void declare(Parser& parser);
  /// Throws UsageError.
  void check() const;
  /// The map, made when it is missing; null without a file.
  std::unique_ptr<pipeline::MapStore> open(const RecognizerSource& source) const;
  /// What the drive is called in the map.
  std::string drive_of(const pipeline::Dataset& dataset) const {
    return !drive.empty() ? drive : !dataset.sequence.empty() ? dataset.sequence : dataset.name;
  }
};

}  // namespace revisit::cli
