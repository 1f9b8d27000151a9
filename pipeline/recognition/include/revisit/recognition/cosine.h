#pragma once

#include <span>

namespace revisit::pipeline {

/// In double precision; the same numbers give the same bits.
double length_of(std::span<const float> x);

/// Cosine of two rows with their lengths, in double; 0 for a zero row. Equal rows give equal bits.
double cosine(std::span<const float> a, double length_a, std::span<const float> b, double length_b);

}  // namespace revisit::pipeline
