#include <openssl/evp.h>

#include <algorithm>
#include <cmath>
#include <set>

#include "cli/json.h"
#include "cli/terminal.h"
#include "report/report.h"
#include "report_assets.h"
#include "revisit/base/error.h"
#include "revisit/base/files.h"
#include "revisit/datasets/scan_file.h"
#include "revisit/recognition/feature.h"

namespace revisit::cli {

namespace {

namespace fs = std::filesystem;

constexpr double kReloadSeconds = 3;

enum Flag { kAccepted = 1, kCorrect = 2, kPositive = 4, kIgnored = 8, kCase2 = 16 };

std::string name_of_run(const reports::Run& run) {
  const reports::RunInfo& info = run.info();
  const std::string data = fs::path(info.data()).filename().string();
  std::string title = info.sequence().empty() ? data : info.sequence();
  if (info.feature() != data) title += ", " + info.feature();
  if (!info.model().empty() && !info.trained()) title += " (UNTRAINED)";
  const auto& configuration = run.configuration();
  for (const auto& [name, usual] :
       std::vector<std::pair<std::string, std::string>>{{"protocol", "driving-order"},
                                                        {"align", "case1"},
                                                        {"query-case", "protocol"},
                                                        {"score", "margin"},
                                                        {"pca", "400"},
                                                        {"every", "1"}}) {
    const auto found = configuration.find(name);
    if (found == configuration.end() || found->second == usual) continue;
    title += ", " + (name == "protocol" ? "" : name + " ") + found->second;
  }
  return title;
}

/// Chooses incorrect queries with the highest scores, missed ones with the lowest, correct ones
/// evenly.
void choose_queries(int most, reports::RunTask* task) {
  std::vector<int> incorrect, missed, correct;
  for (int q = 0; q < task->scan_size(); ++q) {
    const int flags = task->flags(q);
    if (flags & kIgnored) continue;
    if (flags & kAccepted)
      (flags & kCorrect ? correct : incorrect).push_back(q);
    else if (flags & kPositive)
      missed.push_back(q);
  }
  const auto score = [&](int q) { return task->score(q); };
  std::ranges::stable_sort(incorrect, std::ranges::greater{}, score);
  std::ranges::stable_sort(missed, {}, score);
  const auto show = [&](const char* kind, int query) {
    reports::ShownQuery& shown = *task->add_shown();
    shown.set_kind(kind);
    shown.set_query(query);
  };
  const auto wanted = static_cast<size_t>(most);
  for (size_t i = 0; i < std::min(incorrect.size(), wanted); ++i) show("incorrect", incorrect[i]);
  for (size_t i = 0; i < std::min(missed.size(), wanted); ++i) show("missed", missed[i]);
  const size_t n = std::min(correct.size(), wanted);
  for (size_t i = 0; i < n; ++i) show("correct", correct[(2 * i + 1) * correct.size() / (2 * n)]);
}

void show_queries(int most, const reports::Run& run, RangeImages& images, reports::RunTask* task) {
  choose_queries(most, task);
  const auto image = [&](int scan, bool turned) {
    return scan < 0 ? "" : images.add(run.file(scan), run.info(), turned);
  };
  for (reports::ShownQuery& shown : *task->mutable_shown()) {
    const int q = shown.query(), matches = task->match_size() / task->scan_size();
    shown.add_images(image(task->scan(q), (task->flags(q) & kCase2) != 0));
    for (int i = 0; i < matches; ++i) shown.add_images(image(task->match(q * matches + i), false));
  }
}

/// The map needs the best matches, even if no query is shown.
void keep_best_matches(reports::RunTask* task) {
  task->clear_similarity();
  if (task->scan_size() == 0) return;
  const int matches = task->match_size() / task->scan_size();
  for (int q = 0; q < task->scan_size(); ++q) task->set_match(q, task->match(q * matches));
  task->mutable_match()->Truncate(task->scan_size());
}

void share_scans(reports::Page* page) {
  for (int i = 0; i < page->runs_size(); ++i)
    for (int j = 0; j < i; ++j) {
      reports::Run& run = *page->mutable_runs(i);
      const reports::Run& other = page->runs(j);
      if (other.has_scans_of() || !std::ranges::equal(run.frame(), other.frame()) ||
          !std::ranges::equal(run.x(), other.x()) || !std::ranges::equal(run.z(), other.z()))
        continue;
      run.set_scans_of(j);
      run.clear_frame();
      run.clear_x();
      run.clear_z();
      break;
    }
}

/// Requested runs, else the first run of a drive, those of the comparison first.
std::set<int> runs_to_detail(const reports::Page& page) {
  std::set<int> detailed, in_experiments;
  for (const reports::Experiment& experiment : page.experiments())
    for (const reports::ExperimentRun& run : experiment.runs())
      if (run.has_run()) in_experiments.insert(run.run());
  for (int i = 0; i < page.runs_size(); ++i)
    if (!in_experiments.contains(i)) detailed.insert(i);
  std::set<std::string> drives;
  for (const bool comparison : {true, false})
    for (const reports::Experiment& experiment : page.experiments()) {
      if ((experiment.name() == "comparison") != comparison) continue;
      for (const reports::ExperimentRun& run : experiment.runs())
        if (run.has_run() && drives.insert(page.runs(run.run()).info().sequence()).second)
          detailed.insert(run.run());
    }
  return detailed;
}

constexpr int kMaxWidth = 800, kMaxHeight = 56;  // [pixels], maximum
constexpr float kLevels = 32;                    // fewer gray values make smaller files

RangeImage reduced(const RangeImage& image) {
  RangeImage small;
  small.width = std::min(image.width, kMaxWidth);
  small.height = std::min(image.height, kMaxHeight);
  for (int row = 0; row < small.height; ++row)
    for (int column = 0; column < small.width; ++column) {
      float sum = 0, count = 0;
      for (int y = row * image.height / small.height; y < (row + 1) * image.height / small.height;
           ++y)
        for (int x = column * image.width / small.width;
             x < (column + 1) * image.width / small.width; ++x)
          if (image.at(y, x) > 0) sum += image.at(y, x), ++count;
      const float mean = count > 0 ? sum / count : 0;
      // Gamma 2, because most ranges are a small part of the maximum.
      small.pixels.push_back(std::ceil(std::sqrt(mean / 255) * kLevels) * 255 / kLevels);
    }
  return small;
}

ImageGeometry geometry_of(const reports::RunInfo& info) {
  ImageGeometry g;
  g.width = info.image_width();
  g.height = info.image_height();
  g.elevation_top = info.elevation_top_deg();
  g.elevation_bottom = info.elevation_bottom_deg();
  g.max_range = info.max_range_m();
  g.closing_width = info.closing_width() * 360.0 / g.width;
  g.closing_height = info.closing_height() * (g.elevation_top - g.elevation_bottom) / g.height;
  return g;
}

std::string png_uri(const RangeImage& image) {
  const std::string png = png_of(gray_of(image), "range image");
  std::string text((png.size() + 2) / 3 * 4 + 1, '\0');  // with the final 0 of OpenSSL
  text.resize(static_cast<size_t>(EVP_EncodeBlock(reinterpret_cast<uint8_t*>(text.data()),
                                                  reinterpret_cast<const uint8_t*>(png.data()),
                                                  static_cast<int>(png.size()))));
  return "data:image/png;base64," + text;
}

}  // namespace

void complete_page(const PageOptions& options, reports::Page* page) {
  page->set_title(options.title);
  page->set_version(REVISIT_VERSION);
  page->set_made(local_time("%Y-%m-%d %H:%M"));
  page->set_command(options.command);
  if (options.reloads) page->set_reload_seconds(kReloadSeconds);
  RangeImages images(static_cast<size_t>(options.image_mb * 1e6));
  const std::set<int> detailed = runs_to_detail(*page);
  for (int i = 0; i < page->runs_size(); ++i) {
    reports::Run& run = *page->mutable_runs(i);
    run.set_title(name_of_run(run));
    run.mutable_info()->clear_key();  // long, and unused by the page
    run.clear_folder();
    for (reports::RunTask& task : *run.mutable_tasks()) {
      if (detailed.count(i))
        show_queries(options.queries, run, images, &task);
      else
        keep_best_matches(&task);
    }
    run.clear_file();
  }
  share_scans(page);
  page->mutable_images()->insert(images.images().begin(), images.images().end());
  if (!images.warning().empty()) page->add_warnings(images.warning());
}

std::string html_page(const reports::Page& page) {
  return str(assets::kBeforeData, to_compact_json(page), assets::kAfterData);
}

void need_report(const fs::path& file, const std::string& advice) {
  constexpr const char* kMark = "<main id=\"report\"></main>";  // also of earlier versions
  std::error_code none;
  if (!fs::is_regular_file(file, none) || fs::is_empty(file, none)) return;
  if (content_if_any(file).find(kMark) == std::string::npos)
    throw UsageError(file.string(), ": the file exists and is no report; ", advice);
}

reports::Page write_report(const std::vector<fs::path>& folders, const fs::path& file,
                           const PageOptions& options) {
  reports::Page page = read_runs(folders);
  *page.mutable_summary() = summarize_runs(page.runs(), options.over_sequences).rows();
  complete_page(options, &page);
  write_atomically(file, [&](std::ostream& out) { out << html_page(page); });
  for (const std::string& warning : page.warnings()) warn(warning);
  return page;
}

std::string profile_page(const reports::NetReport& report, const std::string& command) {
  PageOptions options;
  options.title =
      "Profile of " +
      (report.net().empty() ? fs::path(report.prototxt()).filename().string() : report.net());
  options.command = command;
  reports::Page page;
  *page.add_profiles() = report;
  complete_page(options, &page);
  return html_page(page);
}

std::string RangeImages::add(const std::string& scan_file, const reports::RunInfo& info,
                             bool turned) {
  const std::string align = turned ? "case2" : info.align();
  const std::string key =
      str(align, " ", info.image_width(), "x", info.image_height(), " ", scan_file);
  if (images_.count(key)) return key;
  if (bytes_ >= most_bytes_) {
    warning_ = "some range images were skipped to limit the size of the file";
    return "";
  }
  if (!is_scan_file_name(scan_file)) {
    warning_ = "range images are missing, because they are made of scan files, not of recordings";
    return "";
  }
  try {
    const std::string uri = png_uri(
        reduced(scan_to_image(read_scan(scan_file), parse_align_case(align), geometry_of(info))));
    bytes_ += uri.size();
    images_.emplace(key, uri);
    return key;
  } catch (const Error& error) {
    warning_ = str("some range images are missing: ", error.what());
    return "";
  }
}

}  // namespace revisit::cli
