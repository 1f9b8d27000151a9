#pragma once

#include <filesystem>
#include <string>

#include "cli/command.h"
#include "cli/net_options.h"
#include "reports.pb.h"
#include "revisit/profiling/profile.h"

namespace revisit::cli {

Command net_forward_command();
Command net_profile_command();
Command net_verify_command();
Command net_upgrade_command();

struct NetFindings {
  const NetOptions& options;
  std::string weights;
  const engine::Net& net;
  const engine::Plan& plan;
  bool with_buffers = false;
  const profiling::Profile* profile = nullptr;     // null: no times
  const profiling::SpeedLimits* limits = nullptr;  // needs `profile`, as does the next
  double peak_resident_bytes = 0;
};
reports::NetReport net_report(const NetFindings& findings);

/// If the figures themselves prove that other programs ran on the machine: sets `busy` to them and
/// clears the limits, which are not those of the machine then.
void clear_limits_if_busy(reports::NetReport* report);

/// `format`: "table", "json" or "csv".
void print_net_report(const reports::NetReport& report, const std::string& format);

/// Throws InputError if the file is no profile or has too few passes to compare.
reports::NetReport read_profile(const std::filesystem::path& file);
/// Throws InputError if layers or inputs differ.
void need_same_net(const std::filesystem::path& file, const reports::NetReport& before,
                   const reports::NetReport& now);
/// `file`: path of `before`, for messages.
reports::NetComparison compare_profiles(const std::filesystem::path& file,
                                        const reports::NetReport& before,
                                        const reports::NetReport& now);

}  // namespace revisit::cli
