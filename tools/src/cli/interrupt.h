#pragma once

namespace revisit::cli {

/// Installs handlers for SIGINT and SIGTERM: the first asks the running work to stop after its
/// current unit, the second ends the program at once.
void watch_for_interrupt();

/// True once the user asked to stop. Long loops check it between units of work.
bool interrupted();

}  // namespace revisit::cli
