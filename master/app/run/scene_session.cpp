#include "telenano/master/app/run/scene_session.h"

#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <utility>

#include "telenano/common/base/error.h"
#include "telenano/common/config/print.h"
#include "telenano/common/control/method_choice.h"
#include "telenano/master/app/plan/station_plan.h"
#include "telenano/master/app/run/run_metrics.h"
#include "telenano/master/app/run/run_recorder.h"
#include "telenano/master/app/run/session_terms.h"
#include "telenano/master/app/run/shown_ground.h"
#include "telenano/master/app/run/sim_hand.h"
#include "telenano/master/app/scene_files.h"

namespace telenano::app {
namespace {

/// A window that was opened to look around stays when the first task is done; one that was told which task,
/// or for how long, goes with it.
bool stays_open(const RunOptions& options, const SessionView& view, bool simulated) {
  return simulated && view.has_window() && !options.task_given && !options.duration_s;
}

std::vector<std::string> scene_names(const std::vector<SceneChoice>& scenes) {
  std::vector<std::string> names;
  for (const SceneChoice& scene : scenes) names.push_back(scene.name);
  return names;
}

std::vector<std::uint64_t> scene_hashes(const std::vector<SceneChoice>& scenes) {
  std::vector<std::uint64_t> hashes;
  for (const SceneChoice& scene : scenes) hashes.push_back(scene.hash);
  return hashes;
}

/// HOST:PORT, so that the next scene of the session is found where this one is.
std::string address_of(const std::string& url) {
  const std::size_t begin = url.find("//") + 2;
  return url.substr(begin, url.find('/', begin) - begin);
}

}  // namespace

SceneSession::SceneSession(SessionParts& parts, const RunOptions& options, const LinkDelay& link)
    : parts_(parts),
      options_(options),
      link_(link),
      file_(parts.file),
      terminal_(isatty(STDERR_FILENO) != 0) {
  keep_awake();
  tell_welcome();
  plan();
  if (parts_.simulated) make_simulated_hand();
  choose_companding();
  twin_settings_ = twin_config(config().rate_hz);
  has_twin_ = !parts_.twins.empty();
  twin_scene_hash_ = has_twin_ ? parts_.twins[0]->scene_hash() : 0;
  recorder_ = new_recorder(options_);
  recorded_ = options_.record;
  if (!options_.quiet)
    tell_terms(file_, welcome_, link_, slave_.scene_name, check_, planned_, device_info_,
               !options_.record.empty());
  make_station();
  make_loop();
  follow_scaling();
  show();
  live_->set_tip_wish(wish_);
  ask_for_undo();
  live_->set_scene_pipe(parts_.scene.pipe());
  export_metrics();
}

void SceneSession::keep_awake() {
  parts_.starter.call(
      [&] { awake_.emplace(session(), parts_.way, parts_.server, parts_.scene.pipe(), config().rate_hz); });
}

void SceneSession::tell_welcome() {
  if (!parts_.no_twin.empty() && !options_.quiet && !options_.observe)
    tell_no_twin(parts_.no_twin, !file_.chooses_method);
  if (parts_.wants_twin && parts_.twins.empty()) file_.station.method = control::Method::kModel;
  welcome_ = session().welcome();
  wish_ = tip_wish(options_, options_.server, (welcome_.feature_bits & link::kFeatureSharing) != 0);
}

/// Method and scaling, for this link, device and slave.
void SceneSession::plan() {
  // With play-out the controller sees the buffer's delay, not the link's.
  const double answer_s = std::max(link_.median_s, playout_delay_s(file_));
  delay_samples_ = control::loop_delay_samples(answer_s, 1 / config().rate_hz);
  if (file_.chooses_method)
    file_.station.method =
        control::MethodChoice::at_start({answer_s, 0, true, !parts_.twins.empty(), link_.measures});
  slave_ = slave_limits(welcome_);
  device_info_ = parts_.simulated ? device::sim_device_info(file_.plant) : opened().device->info();
  planned_ = choose_scaling(file_, device_info_, slave_, delay_samples_);
  port_ = slave_port(slave_);
  check_ = station::check_scaling(config(), device_info_, port_, delay_samples_);
  if (!check_.safe && !config().allow_unsafe_scaling) throw UserError(check_.text + "; " + check_.advice);
}

void SceneSession::make_simulated_hand() {
  const double start_height_nm = welcome_.start_pos_w_nm.z() - welcome_.surface_z_w_nm;
  const SessionView& view = parts_.view;
  auto device = std::make_unique<device::SimDevice>(
      sim_device_config(file_, start_height_nm),
      hand_motion(options_, file_.task, start_height_nm, options_.observe && !view.has_window()));
  if (view.has_window()) tasks_ = add_tasks(*device, options_, file_.task, start_height_nm, view.pointer());
  opened().motion = device.get();
  opened().device = std::move(device);
  add_pedals(opened(), file_.pedal);
}

void SceneSession::choose_companding() {
  companding_ = companding_of_tasks(file_, tasks_);
  file_.station.companding =
      companding_of(file_, parts_.simulated ? std::string_view(options_.task) : "hand");
}

std::unique_ptr<recording::Recorder> SceneSession::new_recorder(const RunOptions& run) {
  return make_recorder(run, file_, welcome_, link_, opened(), device_info_, planned_,
                       parts_.client_config.nonce_seed, parts_.scene_before, parts_.scene.bundle().get(),
                       has_twin_ ? &twin_settings_ : nullptr, twin_scene_hash_,
                       [this](std::vector<recording::MarkRow>& rows) { mark_rows_.newest(rows); });
}

void SceneSession::make_station() {
  if (!parts_.station) {
    parts_.station.emplace(config(), device_info_, port_);
  } else {
    parts_.station->go_to_scene(config(), port_, nullptr, welcome_.scene_hash);
  }
  if (has_twin_) use_twin(std::move(parts_.twins), welcome_, config(), *parts_.station, options_.quiet);
  marks_.emplace(mark_rows_, marked_sample(parts_.scene, *parts_.station));
}

void SceneSession::make_loop() {
  const SessionHand hand{*opened().device, opened().motion, options_.duration_s.value_or(0)};
  // Who only looks on has no task that could be over: until stopped, or for as long as was said.
  const bool has_task = hand.motion != nullptr && !(options_.observe && !options_.duration_s);
  session_s_ = has_task ? hand.motion->motion_duration_s() : hand.duration_s;
  live_.emplace(hand, parts_.way.datagram(), parts_.server, session(), *parts_.station, recorder_.get(),
                options_.give_up_s, session_s_, parts_.stop, file_.link);
  live_->set_scenes(scene_hashes(parts_.scenes));
  if (options_.practice) live_->set_practice(parts_.way);
  if (file_.chooses_method) live_->choose_method();
  live_->set_companding(companding_);
}

/// A scale that a person gave is kept.
void SceneSession::follow_scaling() {
  if (planned_.empty() || file_.scaling.force || config().allow_unsafe_scaling) return;
  control::ScalingPlanInput input = plan_input(file_, device_info_, slave_, delay_samples_);
  input.velocity_scale = config().scaling.velocity;
  live_->follow_scaling({input, config().scaling.force});
}

void SceneSession::show() {
  // A scene that the server keeps to itself may be here all the same.
  double tip_radius_nm = 0;
  if (parts_.view.wanted() && welcome_.scene.empty())
    if (const auto local = find_scene(slave_.scene_name, slave_.scene_hash, options_.scene))
      tip_radius_nm = local->tip_radius_nm;
  view_model::ViewRequestHandler* const requests = parts_.view.begin(
      {config(), device_info_, slave_, welcome_.feature_bits, delay_samples_, scene_names(parts_.scenes),
       options_.server, options_.record, tasks_, file_.plant.workspace_half_m, options_.give_up_s,
       newest_ground(parts_.scene, *parts_.station),
       [&keeper = parts_.scene, tip_radius_nm] { return shown_scene(keeper, tip_radius_nm); },
       options_.practice});
  if (requests != nullptr) live_->show_on(*requests, stays_open(options_, parts_.view, parts_.simulated));
}

void SceneSession::ask_for_undo() {
  if (!options_.undo_marks_at_s) return;
  if ((welcome_.feature_bits & link::kFeatureUndo) == 0)
    throw UserError("--undo-marks-at: the server's sample keeps no marks, or the server cannot undo them");
  live_->undo_at(*options_.undo_marks_at_s);
}

void SceneSession::export_metrics() {
  if (options_.metrics.empty()) return;
  exporter_.emplace(options_.metrics, options_.metrics_public,
                    [this](metrics::Page& page) { write_metrics(live_->progress(), page); });
  if (!options_.quiet && parts_.scene_before.empty())
    config::print(stderr, "metrics at {}\n", exporter_->url());
  parts_.metrics = address_of(exporter_->url());
}

}  // namespace telenano::app
