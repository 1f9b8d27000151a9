#pragma once

#include <filesystem>
#include <functional>
#include <iosfwd>
#include <string>

#include "loops/scan_stream.h"

namespace revisit::cli {

/// True for a bag, packets, or a data set that the readers of the Python package know
/// (docs/SCANS.md).
bool is_recording(const std::filesystem::path& data);

/// Scans that come with their points.
struct RecordedScans {
  std::string name = {};  // of the drive
  int64_t count = 0;      // of the scans; 0: unknown
  std::vector<std::string> warnings = {};
  std::string point_times = {};  // convention, or why there are none
  ScanStream next = {};
};

/// True for the first line of the format of docs/reference/FORMATS.md ("Scans on standard input").
bool begins_recorded_scans(const std::string& line);
/// Reads that format. `source` begins messages; `first` is the first line if it is already read;
/// `ending` explains why the stream may have ended too early. This function and `next` throw the
/// error that the stream has, InputError if it is malformed or ends too early, and Interrupted.
RecordedScans recorded_scans(
    std::istream& in, const std::string& source, std::string first = "",
    const std::function<std::string()>& ending = [] { return std::string(); });

/// $REVISIT_PYTHON, or else python3.
std::string python_interpreter();

/// Options of `revisit.recordings` and `revisit.show` that say how scans are read.
Arguments reader_options(const FeatureOptions& data);

/// Starts `revisit.recordings` of the Python package of python_interpreter().
/// `headers`: without points. The process ends with the last copy of `next`. Throws what
/// recorded_scans() throws.
RecordedScans read_recording(const FeatureOptions& data, bool headers = false);

/// Frames, times and poses of all scans of a recording, without points.
Dataset headers_of(const FeatureOptions& data);

/// Copies the points into an unnamed temporary file, 16 to 20 bytes each, for several passes.
Dataset spooled(const RecordedScans& scans);

}  // namespace revisit::cli
