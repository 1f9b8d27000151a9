#pragma once

#include <set>
#include <string>

#include "drive.h"
#include "revisit/pipeline/simulation.h"

namespace revisit::pipeline::simulation {

/// The folder of one simulated sequence.
class DataSet {
 public:
  /// `settings` is the text that tells this data set from any other.
  DataSet(const SimulationConfig& config, std::string settings);

  /// Makes the folder ready to hold the frames `wanted`: refuses files that are not ours or
  /// were made otherwise (UsageError), removes them with `overwrite` when they are ours, and writes
  /// the settings first. Returns the frames that are there already.
  std::set<int> open(const std::set<int>& wanted, bool overwrite);
  /// Writes poses, calibration and times.
  void write_frame(const std::string& poses, const std::string& calibration,
                   const std::string& times);

  std::filesystem::path scan_file(int frame) const;

 private:
  std::set<int> scans_there() const;
  std::string difference() const;

  std::filesystem::path sequence_, velodyne_, settings_file_, poses_file_;
  std::string settings_;
};

/// What decides the bytes of a scan besides its frame number.
std::string settings_text(const SimulationConfig& config, const Drive& drive);

}  // namespace revisit::pipeline::simulation
