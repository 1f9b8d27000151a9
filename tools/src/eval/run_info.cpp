#include "run_info.h"

#include <sys/resource.h>

#include <numeric>

#include "revisit/profiling/profile.h"

namespace revisit::cli {

reports::RunInfo run_info(const FeatureOptions& options, const Dataset& dataset,
                          const FeatureSource& source, const std::string& pca_fit,
                          const EvaluationTimes& times,
                          const std::vector<AlignmentRecord>& alignments) {
  reports::RunInfo info;
  info.set_version(REVISIT_VERSION);
  info.set_data(std::filesystem::absolute(options.data).string());
  info.set_sequence(dataset.sequence);
  info.set_scans(static_cast<int>(dataset.scans.size()));
  info.set_feature(source.extractor.name);
  info.set_feature_dimension(static_cast<double>(source.extractor.dim));
  if (const auto& model = source.model) {
    info.set_model(model->prototxt.string());
    info.set_weights(model->weights.string());
    info.set_weights_sha1(model->weights_sha1);
    info.set_trained(model->trained);
    for (const double mean : model->mean_bgr) info.add_mean_bgr(mean);
  }
  const ImageGeometry g = options.image.geometry();
  info.set_image_width(g.width);
  info.set_image_height(g.height);
  info.set_elevation_top_deg(g.elevation_top);
  info.set_elevation_bottom_deg(g.elevation_bottom);
  info.set_max_range_m(g.max_range);
  const ClosingRectangle closing = closing_rectangle(g);
  info.set_closing_width(closing.width);
  info.set_closing_height(closing.height);
  info.set_sensor(options.image.sensor);
  info.set_pca_fit(pca_fit);
  info.set_threads(options.thread_count());
  info.set_threads_per_scan(options.threads_per_scan);
  info.set_precision(options.precision == engine::Precision::kBf16 ? "bf16" : "float32");
  for (const StageTimes& stage : stages_of(times)) {
    const profiling::Timing timing = profiling::summarize(stage.ms);
    reports::Stage& out = *info.add_stages();
    out.set_name(stage.name);
    out.set_count(static_cast<int>(stage.ms.size()));
    out.set_median_ms(timing.median);
    out.set_p95_ms(timing.p95);
    out.set_total_ms(std::accumulate(stage.ms.begin(), stage.ms.end(), 0.0));
  }
  if (const auto speed = frames_per_second(times.describe)) info.set_frames_per_second(*speed);
  if (const auto speed = scans_per_second(times.describe)) info.set_scans_per_second(*speed);
  info.set_align(name_of(source.align));
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  info.set_peak_resident_bytes(static_cast<double>(usage.ru_maxrss) * 1024);
  for (size_t i = 0; i < alignments.size(); ++i)
    if (alignments[i].described == 0)
      info.add_left_out(std::filesystem::absolute(dataset.scans[i].file).string());
  info.set_scans_left_out(info.left_out_size());
  return info;
}

}  // namespace revisit::cli
