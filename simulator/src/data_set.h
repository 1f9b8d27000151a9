#pragma once

#include <set>

#include "drive.h"
#include "output_folder.h"
#include "revisit/simulation/simulation.h"

namespace revisit::simulation {

/// Must be incremented with every change of scans, because older runs must not be resumed.
constexpr int kWorldVersion = 1;

class DataSet {
 public:
  DataSet(const SimulationConfig& config, const Drive& drive);

  /// Returns the frames that are already complete.
  std::set<int> open(const std::set<int>& wanted, bool overwrite);
  void write_frame(const std::string& poses, const std::string& calibration,
                   const std::string& times);

  std::filesystem::path scan_file(int frame) const;
  std::filesystem::path image_file(int frame) const;

 private:
  std::filesystem::path sequence_, poses_file_;
  bool with_images_, with_times_;
  OutputFolder folder_;
};

}  // namespace revisit::simulation
