#pragma once

#include "cli/command.h"

namespace revisit::cli {

int map_remove_command(const Arguments&);
int map_forget_command(const Arguments&);

}  // namespace revisit::cli
