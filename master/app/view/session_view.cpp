#include "telenano/master/app/view/session_view.h"

#include <fmt/format.h>

#include <atomic>
#include <cmath>
#include <cstdio>
#include <exception>
#include <filesystem>
#include <optional>
#include <thread>

#include "telenano/common/base/error.h"
#include "telenano/common/config/print.h"
#include "telenano/common/rt/background.h"
#include "telenano/common/rt/signals_blocked.h"
#include "telenano/common/surface/gsf.h"
#include "telenano/master/app/plan/station_plan.h"
#include "telenano/master/app/scene_files.h"
#include "telenano/master/app/view/picture_size.h"
#include "telenano/master/station/station.h"
#include "telenano/master/viewer/photographer.h"
#include "telenano/master/viewer/window.h"

namespace telenano::app {
namespace {

namespace fs = std::filesystem;

constexpr double kSliderReach = 50;  // of the velocity scale's slider to either side of the planned one
constexpr double kForceReach = 1e4;  // of the force scale's slider below the planned one

// Reads the scan again when the file has changed since. A file that is just being written, or has gone,
// changes nothing: the old picture stays.
class WatchedScan {
 public:
  explicit WatchedScan(std::string path) : path_(std::move(path)), seen_(fs::last_write_time(path_)) {}
  std::optional<view_model::Ground> changed() {
    std::error_code error;
    const auto now = fs::last_write_time(path_, error);
    if (error || now == seen_) return std::nullopt;
    seen_ = now;
    try {
      return view_model::Ground(surface::heights_in_frame_w(surface::read_gsf(path_)));
    } catch (const std::exception&) {
      return std::nullopt;
    }
  }

 private:
  std::string path_;
  fs::file_time_type seen_;
};

}  // namespace

struct SessionView::Parts {
  PictureSize size;
  std::optional<surface::Scan> scan;
  std::string scan_bytes;
  std::optional<view_model::Ground> ground;
  std::function<std::optional<surface::HeightGrid>()> fetched_ground;
  std::function<view_model::ServerScene()> server_scene;
  viewer::ViewFacts facts;
  std::optional<viewer::SessionWindow> window;
};

SessionView::SessionView(const ViewOptions& options, bool mouse)
    : options_(options), mouse_(mouse), parts_(std::make_unique<Parts>()) {
  photo_ = !options.screenshot.empty();
  window_ = !photo_ && !options.no_view && (options.view || (mouse && viewer::has_display()));
  if (options.guide && !wanted()) throw UserError("--guide needs the window: add --view, or omit --no-view");
  if (mouse && !window_) {
    throw UserError(
        photo_ || options.no_view
            ? "--device mouse needs the window, so it does not work with --screenshot or --no-view"
            : "--device mouse needs a window, and there is no display: log in graphically or with ssh -X");
  }
  if (!std::isfinite(options.tip_radius_nm) || !std::isfinite(options.at_s))
    throw UserError("--tip-radius-nm, --at: expected finite numbers");
  if (photo_) {
    parts_->size = parse_picture_size(options.screenshot_size);
    const fs::path folder = fs::path(options.screenshot).parent_path();
    if (!folder.empty() && !fs::is_directory(folder))
      throw UserError("--screenshot: " + folder.string() + " is not a folder");
  }
  if (window_ && !viewer::has_display())
    throw UserError(
        "--view: there is no display; log in graphically or with ssh -X, or use --screenshot FILE.png");
  if (window_) {
    // DISPLAY may name a screen that does not answer, or a machine without OpenGL.
    try {
      parts_->window.emplace();
    } catch (const RunError& error) {
      throw UserError(error.what());
    }
  }
  if (!options.surface.empty()) {
    options_.surface = find_surface(options.surface);
    parts_->scan = surface::read_gsf(options_.surface, &parts_->scan_bytes);
  }
}

SessionView::~SessionView() = default;

void SessionView::wait_for(const Waiting& waiting, const std::function<void()>& work) {
  if (!window_) return work();
  viewer::ViewFacts facts;
  facts.scene_name = waiting.slave.scene_name;
  facts.server = waiting.server;
  facts.surface_z_w_nm = waiting.slave.surface_z_w_nm;
  facts.tip_radius_given_nm = options_.tip_radius_nm;
  facts.text_size = options_.text_size;
  const auto plane = [&] {
    return view_model::Ground(waiting.slave.surface_z_w_nm, waiting.slave.workspace_min_w_nm,
                              waiting.slave.workspace_max_w_nm);
  };
  viewer::WaitingHooks hooks;
  hooks.cancel = waiting.cancel;
  hooks.server_scene = waiting.server_scene;
  if (!parts_->scan) {
    hooks.changed_ground = [&]() -> std::optional<view_model::Ground> {
      auto grid = waiting.fetched_ground();
      if (!grid) return std::nullopt;
      return grid->z_nm.empty() ? plane() : view_model::Ground(std::move(*grid));
    };
  }
  std::atomic<bool> done{false};
  std::exception_ptr failed;
  std::thread thread;
  {
    const rt::SignalsBlocked blocked;  // signals are for the main thread
    thread = std::thread([&] {
      try {
        work();
      } catch (...) {
        failed = std::current_exception();
      }
      done.store(true, std::memory_order_release);
    });
  }
  hooks.sample_drawn = [this] { note_sample_drawn(); };
  hooks.over = [&] { return done.load(std::memory_order_acquire); };
  try {
    viewer::wait_in_window(
        *parts_->window, facts,
        parts_->scan ? view_model::Ground(surface::heights_in_frame_w(*parts_->scan)) : plane(), port_,
        waiting.tip_w_nm, waiting.words, hooks);
  } catch (...) {
    thread.join();
    throw;
  }
  thread.join();
  if (failed) std::rethrow_exception(failed);
}

view_model::ViewRequestHandler* SessionView::begin(const ViewedSession& session) {
  if (!wanted()) return nullptr;
  // What the loop and the screen have told each other of the sample before.
  recording::Sample old;
  while (port_.samples.pop(old)) {
  }
  view_model::ViewRequest unheard;
  while (port_.requests.pop(unheard)) {
  }
  port_.undo.store({});
  port_.scene.store({});
  viewer::ViewFacts& facts = parts_->facts;
  facts = {};
  facts.scene_name = session.slave.scene_name;
  facts.server = session.server;
  facts.device_name = session.device.name;
  facts.mouse_is_hand = mouse_;
  facts.guide = options_.guide;
  facts.shows_force = session.device.has_force;
  facts.hand_in_box = !mouse_ && !session.device.has_force;
  const device::HandMotionLimits hand{};
  facts.hand_half_m = session.device.workspace_radius_m;
  // From the border of the box to its middle, and until what rounds the corners has died away.
  facts.hand_back_s = facts.hand_half_m * std::sqrt(3.0) / hand.speed_max_m_s + 5 * hand.smooth_s;
  facts.recording = session.recording;
  facts.scenes = session.scenes;
  facts.hand_box_half_m = session.device_half_m;
  for (const SimTask& task : session.tasks)
    facts.tasks.push_back({task.name, task.about, task.reach_nm, task.free});
  facts.surface_z_w_nm = session.slave.surface_z_w_nm;
  facts.workspace_min_w_nm = session.slave.workspace_min_w_nm;
  facts.workspace_max_w_nm = session.slave.workspace_max_w_nm;
  facts.hand_force_limit_n = session.station.force_safety * session.device.force_max_n;
  facts.energy_bound_j = session.station.allowance_j;
  facts.give_up_s = session.give_up_s;
  facts.practice = session.practice;
  facts.tip_radius_given_nm = options_.tip_radius_nm;
  parts_->server_scene = session.server_scene;
  if (parts_->server_scene) facts.scene.tip_radius_nm = parts_->server_scene().tip_radius_nm;
  facts.text_size = options_.text_size;
  facts.can_record = window_;
  facts.can_undo = (session.feature_bits & link::kFeatureUndo) != 0;
  const control::Scaling& planned = session.station.scaling;
  view_model::ScalingRegion& region = facts.region;
  for (const control::Method method : control::kAllMethods) {
    const auto i = static_cast<std::size_t>(method);
    station::StationConfig config = session.station;
    config.method = method;
    region.impedance_bound[i] =
        station::check_scaling(config, session.device, slave_port(session.slave), session.delay_samples)
            .exact_bound;
    facts.method_offered[i] = station::usable_method(method, session.feature_bits) == method;
  }
  region.device_force_scale = control::device_force_scale_bound(
      session.station.force_safety, session.device.force_max_n, session.slave.force_max_nn);
  region.velocity_planned = planned.velocity;
  region.velocity_min = planned.velocity / kSliderReach;
  region.velocity_max = planned.velocity * kSliderReach;
  region.force_min = planned.force / kForceReach;
  region.unsafe_allowed = session.station.allow_unsafe_scaling;
  if (parts_->scan) {
    facts.surface_doubt =
        doubt_of_surface({options_.surface, parts_->scan_bytes, *parts_->scan}, session.slave);
    if (!facts.surface_doubt.empty())
      config::print(stderr, "note: --surface {}: {}\n", options_.surface, facts.surface_doubt);
    parts_->scan_bytes = {};
    parts_->ground.emplace(surface::heights_in_frame_w(std::move(*parts_->scan)));
    parts_->scan.reset();
  } else {
    parts_->fetched_ground = session.fetched_ground;
    parts_->ground.emplace(session.slave.surface_z_w_nm, session.slave.workspace_min_w_nm,
                           session.slave.workspace_max_w_nm);
    if (parts_->fetched_ground) {
      // Kept from an earlier session, it is there from the first picture on.
      if (auto grid = parts_->fetched_ground(); grid && !grid->z_nm.empty())
        parts_->ground.emplace(std::move(*grid));
    }
  }
  requests_ = std::make_unique<view_model::ViewRequestHandler>(port_, region.impedance_bound);
  return requests_.get();
}

std::string SessionView::run(const RealTimeSession& live, bool give_way, const Callbacks& callbacks) {
  if (give_way) {
    rt::enter_background();
    if (parts_->window) rt::enter_background(parts_->window->window.drawing_threads());
  }
  viewer::ViewHooks hooks;
  hooks.session_over = [&] {
    callbacks.each();
    return live.finished();
  };
  hooks.record = callbacks.record;
  hooks.recording = [&callbacks] {
    const recording::Recorder* const recorder = callbacks.recorder();
    if (recorder == nullptr) return viewer::RecordingStatus{};
    const bool failed = recorder->failed();
    return viewer::RecordingStatus{recorder->rows_written(), failed, failed ? recorder->failure() : ""};
  };
  std::optional<WatchedScan> watched;
  if (!options_.surface.empty()) {
    watched.emplace(options_.surface);
    hooks.changed_ground = [&watched] { return watched->changed(); };
  } else if (parts_->fetched_ground) {
    hooks.changed_ground = [this]() -> std::optional<view_model::Ground> {
      auto grid = parts_->fetched_ground();
      if (!grid) return std::nullopt;
      if (!grid->z_nm.empty()) return view_model::Ground(std::move(*grid));
      const viewer::ViewFacts& facts = parts_->facts;
      return view_model::Ground(facts.surface_z_w_nm, facts.workspace_min_w_nm, facts.workspace_max_w_nm);
    };
  }
  hooks.server_scene = parts_->server_scene;
  hooks.pointer = &pointer_;
  hooks.sample_drawn = [this] { note_sample_drawn(); };
  hooks.session_end = callbacks.session_end;
  hooks.stop_wanted = callbacks.stop_wanted;
  try {
    std::string frames = draw(hooks, live);
    if (callbacks.goes_on && callbacks.goes_on()) {
      options_.surface.clear();  // a file of the sample that is left
      options_.guide = false;
    } else {
      parts_->window.reset();  // what is left to do needs no picture
    }
    return frames;
  } catch (...) {
    // Without its picture a session would go on unseen, and with a mouse for ever.
    port_.quit.store(true);
    throw;
  }
}

std::string SessionView::draw(const viewer::ViewHooks& hooks, const RealTimeSession& live) {
  if (photo_) {
    viewer::PhotoOptions photo{options_.screenshot, options_.at_s, parts_->size.width_px,
                               parts_->size.height_px};
    viewer::photograph(parts_->facts, std::move(*parts_->ground), port_, hooks, photo,
                       [&live] { return live.progress().time_s; });
    return "picture: " + options_.screenshot;
  }
  const auto [frames, again] =
      viewer::run_window(*parts_->window, parts_->facts, std::move(*parts_->ground), port_, hooks);
  again_ = again;
  return fmt::format(
      "viewer: {} frames, {:.1f} ms each (p50), {:.1f} ms (p99){}", frames.count(),
      1e-6 * static_cast<double>(frames.percentile_ns(0.5)),
      1e-6 * static_cast<double>(frames.percentile_ns(0.99)),
      sample_drawn_s_ ? fmt::format("; the sample seen after {:.2f} s", *sample_drawn_s_) : "");
}

void SessionView::note_sample_drawn() noexcept {
  if (!sample_drawn_s_)
    sample_drawn_s_ = std::chrono::duration<double>(std::chrono::steady_clock::now() - began_).count();
}

}  // namespace telenano::app
