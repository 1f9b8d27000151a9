#pragma once

namespace revisit::cli {

/// Handles SIGINT and SIGTERM: the first stops the work after its current unit, the second at once.
void watch_for_interrupt();

/// True after a signal. Long loops check it between units of work.
bool interrupted();

}  // namespace revisit::cli
