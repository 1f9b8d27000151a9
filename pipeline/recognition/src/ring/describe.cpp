#include "revisit/recognition/ring/describe.h"

#include <array>
#include <cmath>
#include <numbers>

#include "revisit/base/error.h"
#include "ring/projection.h"
#include "ring/spectrum.h"

namespace revisit {

void check_options(const RingOptions& options) {
  if (options.dim < 2 || options.dim > 1 << 16)
    throw UsageError("ring dimensions: expected 2 to 65536, found ", options.dim);
  if (!(options.regularization > 0) || !std::isfinite(options.regularization))
    throw UsageError("ring regularization: expected a value above 0, found ",
                     options.regularization);
  if (options.code_candidates < 0)
    throw UsageError("ring key candidates: expected at least 0, found ", options.code_candidates);
  if (!(options.blend >= 0 && options.blend <= 1))
    throw UsageError("ring blend: expected 0 to 1, found ", options.blend);
}

struct RingDescriber::Impl {
  std::array<std::vector<float>, 2> means;
  std::array<double, 2> shares;  // weights of the rings in a descriptor's squared length
  std::array<RingPlace, 2> places;
  std::array<Spectrum, 2> spectra;
  std::array<RingProjection, 2> projections;
  RingLayout layout;
};

RingDescriber::RingDescriber(const RingModel& model, const RingOptions& options) {
  check_options(options);
  const auto projection = [&](const RingStatistics& ring) {
    return project_rings(ring, options.regularization, options.dim / 2);
  };
  Impl impl{{model.columns.mean, model.polar.mean},
            {model.cnn_weight, 1 - model.cnn_weight},
            rings_of(model),
            {Spectrum(model.columns.sectors), Spectrum(model.polar.sectors)},
            {projection(model.columns), projection(model.polar)},
            {}};
  for (size_t f = 0; f < kRingFrequencies; ++f)
    impl.layout.counts.push_back(
        static_cast<int>(impl.projections[0][f].rows() + impl.projections[1][f].rows()));
  impl_ = std::make_shared<const Impl>(std::move(impl));
}

const RingLayout& RingDescriber::layout() const {
  return impl_->layout;
}

void RingDescriber::describe(std::span<const float> rings, std::span<float> descriptor) const {
  const float twice = std::numbers::sqrt2_v<float>;
  std::array<std::vector<Eigen::VectorXcf>, 2> z;  // [frequency] [kept]
  for (size_t part = 0; part < 2; ++part) {
    const RingPlace& place = impl_->places[part];
    const Eigen::MatrixXcf x =
        impl_->spectra[part].of(rings.data(), impl_->means[part].data(), place);
    double square = 0;
    for (Eigen::Index f = 0; f < x.rows(); ++f) {
      Eigen::VectorXcf& of_frequency = z[part].emplace_back(
          impl_->projections[part][static_cast<size_t>(f)] * x.row(f).transpose());
      // Frequencies above 0 also represent their negative counterparts.
      if (f == 0)
        of_frequency.imag().setZero();
      else
        of_frequency *= twice;
      square += static_cast<double>(of_frequency.squaredNorm());
    }
    const auto scale =
        square > 0 ? static_cast<float>(std::sqrt(impl_->shares[part] / square)) : 0.0F;
    for (Eigen::VectorXcf& of_frequency : z[part]) of_frequency *= scale;
  }
  float* to = descriptor.data();
  for (size_t f = 0; f < impl_->layout.counts.size(); ++f) {
    for (const auto& part : z)
      for (const std::complex<float> value : part[f]) *to++ = value.real();
    if (f == 0) continue;
    for (const auto& part : z)
      for (const std::complex<float> value : part[f]) *to++ = value.imag();
  }
}

}  // namespace revisit
