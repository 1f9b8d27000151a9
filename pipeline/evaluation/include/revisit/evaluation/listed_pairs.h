#pragma once

#include <filesystem>
#include <map>
#include <set>
#include <string>

#include "revisit/datasets/dataset.h"

namespace revisit {

/// Ground truth as a list of pairs, for recordings without poses. A pair is symmetric, but only its
/// query is queried.
struct ListedPairs {
  using Places = std::map<int, std::set<int>>;  // frame of a query -> frames of its places
  Places correct;                               // empty set: the query is known to have no place
  Places ignored;
  bool complete = false;  // true: unlisted queries have no place; false: unknown

  bool knows(int query) const { return complete || correct.contains(query); }
  std::string text() const;
};

/// Reads a table with a query and a place per line, in the first two columns or in those that a
/// header line names `query` and `place` (or `match`, as written by `revisit gt --pairs`). Commas,
/// semicolons, tabs or blanks separate columns; # begins a comment. A scan is given by its frame or
/// its file name, with or without extension; in a data set of several folders with the folder:
/// "first/000032". A query without a place has none. Frames of the same folder within `near` frames
/// of a place count as places, too.
/// Throws InputError with file:line, also for a frame that the data set does not contain and for an
/// ambiguous name.
ListedPairs::Places read_pairs(const std::filesystem::path& file, const Dataset& dataset,
                               int near = 0);

}  // namespace revisit
