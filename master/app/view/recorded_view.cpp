#include "telenano/master/app/view/recorded_view.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "telenano/common/base/base64.h"
#include "telenano/common/base/error.h"
#include "telenano/common/config/print.h"
#include "telenano/common/recording/recording_reader.h"
#include "telenano/common/surface/gsf.h"
#include "telenano/master/app/scene_files.h"
#include "telenano/master/app/view/picture_size.h"
#include "telenano/master/scene/scene_check.h"
#include "telenano/master/view_model/marked_ground.h"
#include "telenano/master/view_model/playback.h"
#include "telenano/master/viewer/photographer.h"
#include "telenano/master/viewer/window.h"

namespace telenano::app {
namespace {

namespace fs = std::filesystem;

// 120 MB of rows; of a longer recording every n-th is shown.
constexpr std::size_t kRowsMost = 200'000;
constexpr std::size_t kBlock = 4096;

struct Rows {
  std::vector<recording::Sample> rows;
  std::size_t every = 1;
};

/// By rising time: a row whose time is none, or not after the one before, is left out.
Rows read_rows(const recording::RecordingReader& reader) {
  Rows result;
  result.every = reader.rows() / kRowsMost + 1;
  std::vector<recording::Sample> block(kBlock);
  for (std::size_t first = 0; first < reader.rows(); first += kBlock) {
    const std::size_t count = std::min(kBlock, reader.rows() - first);
    reader.read_samples(first, std::span(block).first(count));
    for (std::size_t i = 0; i < count; ++i) {
      if ((first + i) % result.every != 0) continue;
      const bool after = result.rows.empty() || block[i].time_s > result.rows.back().time_s;
      if (std::isfinite(block[i].time_s) && after) result.rows.push_back(block[i]);
    }
  }
  if (result.rows.empty())
    throw UserError(reader.path().string() + ": no row has a time; expected a recording of a session");
  return result;
}

std::vector<view_model::Playback::Mark> read_marks(const recording::RecordingReader& reader) {
  std::vector<view_model::Playback::Mark> marks;
  for (const recording::Event& event : reader.events()) {
    const std::string text(event.text.data(), ::strnlen(event.text.data(), event.text.size()));
    marks.push_back({event.time_s, text == "mark" ? fmt::format("mark {}", event.value) : text});
  }
  return marks;
}

double number_of(const recording::RecordingReader& reader, const char* key, double otherwise) {
  const std::string text = reader.configuration(key);
  char* end = nullptr;
  const double value = std::strtod(text.c_str(), &end);
  return end == text.c_str() || !std::isfinite(value) ? otherwise : value;
}

viewer::ViewFacts facts_of(const recording::RecordingReader& reader, const ViewOptions& options,
                           std::size_t every) {
  viewer::ViewFacts facts;
  facts.scene_name = reader.configuration("scene_name");
  facts.device_name = reader.configuration("haptic.name");
  facts.played = reader.path().filename().string();
  if (every > 1) facts.played += fmt::format(": every {}th row", every);
  if (reader.cut_short()) facts.played += " (was cut short)";
  facts.shows_force = reader.configuration("haptic.has_force") != "false";
  facts.surface_z_w_nm = number_of(reader, "surface_z_w_nm", 0);
  facts.hand_force_limit_n =
      number_of(reader, "limits.force_safety", 0) * number_of(reader, "haptic.force_max_n", 0);
  facts.energy_bound_j = number_of(reader, "control.allowance_j", 0);
  facts.tip_radius_given_nm = options.tip_radius_nm;
  if (const auto local = find_scene(facts.scene_name, reader.configuration("scene_hash")))
    facts.scene.tip_radius_nm = local->tip_radius_nm;
  facts.text_size = options.text_size;
  return facts;
}

/// The plane under where the tip has been.
view_model::Ground plane_under(const std::vector<recording::Sample>& rows, double surface_z_w_nm) {
  constexpr double kRoom_nm = 20;
  Vec3 low = Vec3::Constant(0);
  Vec3 high = Vec3::Constant(0);
  bool any = false;
  for (const recording::Sample& row : rows) {
    const Vec3 tip(row.tip_pos_w_nm[0], row.tip_pos_w_nm[1], row.tip_pos_w_nm[2]);
    if (row.reply_sequence == 0 || !is_finite(tip)) continue;
    low = any ? Vec3(low.cwiseMin(tip)) : tip;
    high = any ? Vec3(high.cwiseMax(tip)) : tip;
    any = true;
  }
  return {surface_z_w_nm, low - Vec3::Constant(kRoom_nm), high + Vec3::Constant(kRoom_nm)};
}

/// The scene's surface where the recording holds the scene; what does not hold together is a plane, and said.
view_model::Ground recorded_ground(const recording::RecordingReader& reader,
                                   const std::vector<recording::Sample>& rows, viewer::ViewFacts& facts) {
  const std::string held = reader.configuration("scene_bundle");
  if (!held.empty()) {
    try {
      const auto bundle = from_base64(held);
      if (!bundle) throw RunError("is not a valid bundle");
      scene_store::CheckedScene scene =
          scene_store::read_finding(scene_store::SceneChecker().look_at(*bundle));
      if (fmt::format("{:016x}", scene.scene_hash) != reader.configuration("scene_hash"))
        throw RunError("differs from the session's");
      facts.scene.tip_radius_nm = scene.tip_radius_nm;
      if (!scene.ground.z_nm.empty()) return view_model::Ground(std::move(scene.ground));
    } catch (const std::exception& error) {
      config::print(stderr, "note: {}: the scene in it: {}; a plane is drawn\n", reader.path().string(),
                    error.what());
    }
  }
  return plane_under(rows, facts.surface_z_w_nm);
}

view_model::Ground scan_ground(const recording::RecordingReader& reader, const std::string& text,
                               std::string& doubt) {
  const std::string path = find_surface(text);
  std::string bytes;
  surface::Scan scan = surface::read_gsf(path, &bytes);
  config::SlaveLimits session;
  session.scene_name = reader.configuration("scene_name");
  session.scene_hash = reader.configuration("scene_hash");
  doubt = doubt_of_surface({path, bytes, scan}, session);
  if (!doubt.empty()) config::print(stderr, "note: --surface {}: {}\n", path, doubt);
  return view_model::Ground(surface::heights_in_frame_w(std::move(scan)));
}

}  // namespace

std::string view_recording(const std::string& file, const ViewOptions& options) {
  const bool photo = !options.screenshot.empty();
  if (!std::isfinite(options.tip_radius_nm) || !std::isfinite(options.at_s))
    throw UserError("--tip-radius-nm, --at: expected finite numbers");
  PictureSize size;
  if (photo) {
    size = parse_picture_size(options.screenshot_size);
    const fs::path folder = fs::path(options.screenshot).parent_path();
    if (!folder.empty() && !fs::is_directory(folder))
      throw UserError("--screenshot: " + folder.string() + " is not a folder");
  }
  const recording::RecordingReader reader = recording::RecordingReader::isolated(file);
  if (!photo && !viewer::has_display())
    throw UserError("there is no display; log in graphically or with ssh -X, or use --screenshot FILE.png");
  std::optional<viewer::SessionWindow> window;
  if (!photo) {
    try {
      window.emplace();
    } catch (const RunError& error) {
      throw UserError(error.what());
    }
  }
  for (const char* column : {"time_s", "tip_pos_w_nm", "force_w_nn"}) {
    if (!reader.has(column))
      throw UserError(file + ": no column " + column + ", expected a recording of a session");
  }
  Rows read = read_rows(reader);
  viewer::ViewFacts facts = facts_of(reader, options, read.every);
  view_model::Ground ground = options.surface.empty()
                                  ? recorded_ground(reader, read.rows, facts)
                                  : scan_ground(reader, options.surface, facts.surface_doubt);
  // A surface that somebody gives is drawn as it is.
  view_model::MarkedGround marked(
      ground.heights(), options.surface.empty() ? reader.marks() : std::vector<recording::MarkRow>());
  view_model::Playback playback(std::move(read.rows), read_marks(reader));
  if (photo) {
    marked.move_to(options.at_s);
    if (marked.heights() != nullptr) ground = view_model::Ground(*marked.heights());
    viewer::photograph_recording(facts, std::move(ground), playback,
                                 {options.screenshot, options.at_s, size.width_px, size.height_px});
    return fmt::format("picture: {}, {:.3f} s of the recording", options.screenshot, playback.time_s());
  }
  view_model::ViewPort port;
  viewer::ViewHooks hooks;
  hooks.session_over = [] { return false; };
  hooks.recording = [] { return viewer::RecordingStatus{}; };
  hooks.playback = &playback;
  if (marked.has_marks()) {
    hooks.changed_ground = [&marked, &playback, unmarked = ground]() -> std::optional<view_model::Ground> {
      if (!marked.move_to(playback.time_s())) return std::nullopt;
      return marked.heights() != nullptr ? view_model::Ground(*marked.heights()) : unmarked;
    };
  }
  const rt::LogHistogram frames = viewer::run_window(*window, facts, std::move(ground), port, hooks).frames;
  return fmt::format("viewer: {} frames, {:.1f} ms each (p50), {:.1f} ms (p99)", frames.count(),
                     1e-6 * static_cast<double>(frames.percentile_ns(0.5)),
                     1e-6 * static_cast<double>(frames.percentile_ns(0.99)));
}

}  // namespace telenano::app
