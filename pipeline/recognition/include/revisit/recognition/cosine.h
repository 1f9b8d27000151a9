#pragma once

#include <span>

namespace revisit::pipeline {

/// In double precision; the same numbers give the same bits.
double length_of(std::span<const float> x);

/// Of two rows with their lengths, in double precision; 0 when one of them is zero. The same rows
/// give the same bits.
double cosine(std::span<const float> a, double length_a, std::span<const float> b, double length_b);

}  // namespace revisit::pipeline
