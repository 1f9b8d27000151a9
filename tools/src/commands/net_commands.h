#pragma once

#include "cli/command.h"
#include "cli/net_options.h"
#include "revisit/engine/profile.h"

namespace revisit::cli {

int net_inspect_command(const Arguments&);
int net_forward_command(const Arguments&);
int net_layers_command(const Arguments&);
int net_profile_command(const Arguments&);
int net_verify_command(const Arguments&);
int net_upgrade_command(const Arguments&);

/// What inspect and profile know of a net.
struct NetFindings {
  const NetOptions& options;
  std::string weights;
  const engine::Net& net;
  const engine::Plan& plan;
  const engine::Profile* profile;  // null: nothing was timed
  bool with_buffers;               // also the memory plan
};

/// Prints the layers and totals as "table", "json" or "csv".
void print_net_report(const NetFindings& findings, const std::string& format);

}  // namespace revisit::cli
