#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "revisit/engine/tensor.h"
#include "revisit/proto/npy.h"

namespace revisit::cli {

/// Pictures resized to the input of a net: [pictures][c][h][w], values 0 to 255, BGR or RGB.
/// `input`: shape of the net's input `blob`, [n][c][h][w] with c = 3, or 1 for gray pictures.
/// Throws UsageError for another shape, InputError for a file that is no picture.
proto::NpyArray picture_input(const std::vector<std::filesystem::path>& files,
                              const std::string& blob, const engine::Shape& input, bool rgb);

}  // namespace revisit::cli
