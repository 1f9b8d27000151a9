#pragma once

#include "cli/command.h"
#include "cli/net_options.h"
#include "reports.pb.h"
#include "revisit/engine/profile.h"

namespace revisit::cli {

int net_inspect_command(const Arguments&);
int net_forward_command(const Arguments&);
int net_layers_command(const Arguments&);
int net_profile_command(const Arguments&);
int net_verify_command(const Arguments&);
int net_upgrade_command(const Arguments&);

/// The layers and totals of a plan, with timings when there are any; shared by inspect and profile.
reports::NetReport net_report(const NetOptions& options, const std::string& weights,
                              const engine::Net& net, const engine::Plan& plan,
                              const engine::Profile* profile);

/// Adds the memory plan to a report.
void add_buffers(const engine::Plan& plan, reports::NetReport* report);

/// Prints a report as "table", "json" or "csv". Throws UsageError for another format.
void print_net_report(const reports::NetReport& report, const std::string& format);

}  // namespace revisit::cli
