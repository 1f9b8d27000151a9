// Counts how busy more threads than the machine has would be. A plan for THREADS threads runs on
// one, which times every piece of every parallel region.
//   revisit_busy_threads NET.prototxt THREADS [gray]
// Prints as JSON the layer that loses most, and the time of a dynamic schedule of the pieces with
// unlimited memory bandwidth. Also prints the fraction of time in regions of fewer pieces than
// threads and outside of regions.
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <numeric>
#include <queue>

#include "revisit/engine/net.h"
#include "revisit/engine/parallel_for.h"

namespace {

using namespace revisit::engine;

double now_ms() {
  using namespace std::chrono;
  return duration<double, std::milli>(steady_clock::now().time_since_epoch()).count();
}

using Region = std::vector<double>;  // pieces [ms]

/// End of the last piece; the first free thread takes the next piece.
double scheduled_ms(const Region& pieces, int threads) {
  std::priority_queue<double, std::vector<double>, std::greater<>> free_at;
  for (int i = 0; i < threads; ++i) free_at.push(0);
  double end = 0;
  for (const double ms : pieces) {
    const double done = free_at.top() + ms;
    free_at.pop();
    free_at.push(done);
    end = std::max(end, done);
  }
  return end;
}

struct LayerRegions {
  double ms = 0;
  std::vector<Region> regions;

  double parallel_ms() const {
    double sum = 0;
    for (const Region& region : regions) sum = std::accumulate(region.begin(), region.end(), sum);
    return sum;
  }
  double serial_ms() const { return std::max(ms - parallel_ms(), 0.0); }
  double scheduled_ms(int threads) const {
    double sum = serial_ms();
    for (const Region& region : regions) sum += ::scheduled_ms(region, threads);
    return sum;
  }
};

/// Keeps the minimum time of each piece over two passes with equal pieces.
void keep_faster(const std::vector<LayerRegions>& pass, std::vector<LayerRegions>* fastest) {
  for (size_t i = 0; i < pass.size(); ++i) {
    LayerRegions& best = (*fastest)[i];
    const double serial = std::min(best.serial_ms(), pass[i].serial_ms());
    for (size_t r = 0; r < pass[i].regions.size(); ++r)
      for (size_t k = 0; k < pass[i].regions[r].size(); ++k)
        best.regions[r][k] = std::min(best.regions[r][k], pass[i].regions[r][k]);
    best.ms = serial + best.parallel_ms();
  }
}

class Watch {
 public:
  explicit Watch(size_t layers) : layers_(layers) {}

  void observe(size_t layer, bool done) {
    if (done) {
      layers_[layer].ms += now_ms() - start_;
      return;
    }
    layer_ = layer;
    start_ = now_ms();
  }
  Region& new_region() { return layers_[layer_].regions.emplace_back(); }
  const std::vector<LayerRegions>& layers() const { return layers_; }

 private:
  std::vector<LayerRegions> layers_;
  size_t layer_ = 0;
  double start_ = 0;
};

Watch* watch = nullptr;

double total_ms(const std::vector<LayerRegions>& layers) {
  return std::accumulate(layers.begin(), layers.end(), 0.0,
                         [](double sum, const LayerRegions& layer) { return sum + layer.ms; });
}

void report(const Plan& plan, const std::vector<LayerRegions>& layers, int threads) {
  double scheduled = 0, serial = 0, scarce = 0;
  std::vector<std::pair<double, size_t>> lost;  // against all threads busy
  for (size_t i = 0; i < layers.size(); ++i) {
    scheduled += layers[i].scheduled_ms(threads);
    serial += layers[i].serial_ms();
    for (const Region& region : layers[i].regions)
      if (region.size() < static_cast<size_t>(threads))
        scarce = std::accumulate(region.begin(), region.end(), scarce);
    lost.emplace_back(layers[i].scheduled_ms(threads) - layers[i].ms / threads, i);
  }
  const auto [ms, i] = *std::max_element(lost.begin(), lost.end());
  size_t pieces = 0;
  for (const Region& region : layers[i].regions) pieces = std::max(pieces, region.size());
  const double all = total_ms(layers);
  std::printf(
      "{\"threads\": %d, \"one_thread_ms\": %.6g, \"scheduled_ms\": %.6g, \"scarce_share\": %.6g, "
      "\"serial_share\": %.6g, \"loss\": {\"layer\": \"%s\", \"kernel\": \"%s\", \"pieces\": %zu, "
      "\"lost_ms\": %.6g}}\n",
      threads, all, scheduled, scarce / all, serial / all, plan.layers()[i].name.c_str(),
      plan.layers()[i].kernel.c_str(), pieces, ms);
}

}  // namespace

/// Replaces the engine's function: one thread processes all items in order.
void revisit::engine::share_items(int64_t items, int,
                                  void (*work)(const void* object, int64_t item, int thread),
                                  const void* object) {
  Region unwatched;  // before the first pass
  Region& region = watch ? watch->new_region() : unwatched;
  for (int64_t item = 0; item < items; ++item) {
    const double start = now_ms();
    work(object, item, 0);
    region.push_back(now_ms() - start);
  }
}

int main(int argc, char** argv) try {
  if (argc < 3) {
    std::fprintf(stderr, "usage: %s PROTOTXT THREADS [gray]\n", argv[0]);
    return 2;
  }
  const int threads = std::stoi(argv[2]);
  const Net net = Net::load_with_random_weights(argv[1], 1);
  PlanOptions options{.threads = threads};
  if (argc > 3) options.channel_offsets = std::vector<float>(net.inputs()[0].shape[1], 0.0F);
  Run run(net.plan({}, options));
  for (float& x : run.input(run.plan().inputs()[0].name).values()) x = 1;

  std::vector<LayerRegions> fastest;
  for (int pass = 0; pass < 12; ++pass) {
    Watch of_pass(run.plan().layers().size());
    watch = &of_pass;
    run.forward([&](size_t layer, bool done) { of_pass.observe(layer, done); });
    if (fastest.empty())
      fastest = of_pass.layers();
    else
      keep_faster(of_pass.layers(), &fastest);
  }
  report(run.plan(), fastest, threads);
  return 0;
} catch (const std::exception& error) {
  std::fprintf(stderr, "%s\n", error.what());
  return 1;
}
