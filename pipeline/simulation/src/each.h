#pragma once

#include <cstdint>
#include <functional>

namespace revisit::pipeline::simulation {

/// How many threads share `items`, when `asked` for (0: all there are).
int threads_for(int asked, int64_t items);

/// Calls make(item, thread) once for every item in [0, items), on `threads` threads in no order;
/// then, one at a time, done(item). False of done() ends it all early. Throws what either
/// threw, of the lowest item, when the calls under way are finished.
void for_each_item(int64_t items, int threads,
                   const std::function<void(int64_t item, int thread)>& make,
                   const std::function<bool(int64_t item)>& done);

}  // namespace revisit::pipeline::simulation
