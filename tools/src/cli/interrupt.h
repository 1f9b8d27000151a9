#pragma once

namespace revisit::cli {

/// Handles SIGINT and SIGTERM: the first of either stops the work after its current unit, the
/// second at once.
void watch_for_interrupt();

bool interrupted();

}  // namespace revisit::cli
