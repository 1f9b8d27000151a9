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
  bool with_buffers = false;                       // with the memory plan
  const profiling::Profile* profile = nullptr;     // null: no times
  const profiling::SpeedLimits* limits = nullptr;  // needs `profile`, as does the next
  double peak_resident_bytes = 0;
};
reports::NetReport net_report(const NetFindings& findings);

/// Prints the layers and totals as "table", "json" or "csv".
void print_net_report(const reports::NetReport& report, const std::string& format);

/// Page of `revisit net profile --format html`; only in a program with the pipeline.
std::string profile_page(const reports::NetReport& report, const std::string& command);

/// Draws one node per layer to `file`: .dot, or .svg by Graphviz. Throws UsageError for another
/// extension, Error if drawing fails.
void write_graph(const std::filesystem::path& file, const engine::Net& net,
                 const engine::Plan& plan);

/// Reads an earlier profile. Throws InputError if it is none or has too few passes to compare.
reports::NetReport read_profile(const std::filesystem::path& file);
/// Throws InputError if layers or inputs differ.
void need_same_net(const std::filesystem::path& file, const reports::NetReport& before,
                   const reports::NetReport& now);
/// Compares profiles layer by layer. `file`: that of `before`.
reports::NetComparison compare_profiles(const std::filesystem::path& file,
                                        const reports::NetReport& before,
                                        const reports::NetReport& now);

}  // namespace revisit::cli
