#pragma once

#include <filesystem>
#include <optional>
#include <string>

#include "cli/geometry_options.h"

namespace revisit::cli {

/// A line of `revisit doctor`, and below it the advice, if there is one.
void print_finding(const std::string& name, const std::string& found,
                   const std::string& advice = "");

/// Prints sequences of KITTI, sets of places, or a folder of scans. Returns whether any is usable.
bool print_data(const std::filesystem::path& root);

/// Prints what a recording holds. Throws what read_recording() throws.
void print_recording(const std::filesystem::path& file);

/// How `revisit doctor SCAN` makes a range image.
struct ScanView {
  std::optional<std::filesystem::path> images;  // folder of the PNG files
  std::string align = "case1";                  // case2, none
  double gamma = 1;
  GeometryOptions geometry;

  void declare(Options& options);
};

/// Prints points, alignment and range image of a scan; with ScanView::images writes the image
/// before and after hole closing. Throws InputError if the scan cannot be read or aligned.
void print_scan(const std::filesystem::path& file, ScanView view);

}  // namespace revisit::cli
