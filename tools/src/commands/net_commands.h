#pragma once

#include <filesystem>
#include <string>

#include "cli/command.h"
#include "cli/net_options.h"
#include "reports.pb.h"
#include "revisit/profiling/profile.h"
#include "revisit/profiling/speed_limits.h"

namespace revisit::cli {

int net_inspect_command(const Arguments&);
int net_forward_command(const Arguments&);
int net_layers_command(const Arguments&);
int net_profile_command(const Arguments&);
int net_verify_command(const Arguments&);
int net_upgrade_command(const Arguments&);

struct NetFindings {
  const NetOptions& options;
  std::string weights;
  const engine::Net& net;
  const engine::Plan& plan;
  bool with_buffers = false;                       // also the memory plan
  const profiling::Profile* profile = nullptr;     // null: nothing was timed
  const profiling::SpeedLimits* limits = nullptr;  // this and the next: with `profile`
  double peak_resident_bytes = 0;
};
reports::NetReport net_report(const NetFindings& findings);

/// Prints the layers and totals as "table", "json" or "csv".
void print_net_report(const reports::NetReport& report, const std::string& format);

/// `revisit net profile --format html`, in a program with the pipeline.
std::string profile_page(const reports::NetReport& report, const std::string& command);

/// Draws a node a layer to `file`, .dot or (by Graphviz) .svg; UsageError for others, or Error.
void write_graph(const std::filesystem::path& file, const engine::Net& net,
                 const engine::Plan& plan);

/// An earlier profile. Throws InputError for what is none, or of too few passes to compare.
reports::NetReport read_profile(const std::filesystem::path& file);
/// Throws InputError, naming `file` and what differs, for other layers or inputs.
void need_same_net(const std::filesystem::path& file, const reports::NetReport& before,
                   const reports::NetReport& now);
/// How `now` differs from `before`, layer by layer. `file` is that of `before`.
reports::NetComparison compare_profiles(const std::filesystem::path& file,
                                        const reports::NetReport& before,
                                        const reports::NetReport& now);

}  // namespace revisit::cli
