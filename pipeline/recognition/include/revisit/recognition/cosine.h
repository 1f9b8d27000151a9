#pragma once

#include <span>
#include <vector>

#include "revisit/recognition/matrix.h"

namespace revisit::pipeline {

/// In double precision; the same numbers give the same bits.
double length_of(std::span<const float> x);

/// Lengths of all rows. Throws Error naming the scan (the row) and the alignment case when a value
/// is not finite.
std::vector<double> row_lengths(const FloatMatrix& matrix, int which_case);

/// Of two rows with their lengths, in double precision; 0 when one of them is zero. The same rows
/// give the same bits.
double cosine(std::span<const float> a, double length_a, std::span<const float> b, double length_b);

}  // namespace revisit::pipeline
