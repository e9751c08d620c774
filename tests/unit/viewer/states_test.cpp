// Every state that a person must not misread, as a picture: 35 of them on one sheet, a sixteenth of their
// area each, compared with the sheet that is committed. A badge is a hundred points of it.
#define GLFW_INCLUDE_NONE
#include <GLFW/glfw3.h>
#include <gtest/gtest.h>

#include <cstdlib>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "telenano/common/base/error.h"
#include "telenano/master/device/haptic_device.h"
#include "telenano/master/station/station.h"
#include "telenano/master/viewer/keys.h"
#include "telenano/master/viewer/offscreen.h"
#include "telenano/master/viewer/photographer.h"
#include "telenano/master/viewer/start_screen.h"
#include "telenano/master/viewer/viewer.h"
#include "tests/source_dir.h"
#include "tests/support/view_scene.h"

namespace telenano::viewer {
namespace {

using station::Mode;
using station::TwinState;

constexpr int kWide = 640;
constexpr int kHigh = 480;
constexpr int kLess = 4;
constexpr int kAcross = 6;
constexpr int kTileWide = kWide / kLess;
constexpr int kTileHigh = kHigh / kLess;

struct State {
  const char* name;
  std::int64_t rows = 1650;  ///< of the session that never was: free until about 1600
  std::function<void(recording::Sample&)> last = {};
  std::function<void(ViewFacts&)> facts = {};
  std::function<void(Viewer&, view_model::ViewPort&)> then = {};
  std::vector<int> keys = {};
  bool scan = true;
};

void mode(recording::Sample& s, Mode mode) {
  s.station_mode = static_cast<std::uint32_t>(mode);
}
void silent(recording::Sample& s, double s_s) {
  s.time_s = 60;
  s.reply_age_ms = 1e3 * s_s;
}

std::vector<State> states() {
  using S = recording::Sample;
  const auto stopped = [](std::uint32_t fault) {
    return [fault](S& s) {
      mode(s, Mode::kStopped);
      s.station_faults = fault;
    };
  };
  const auto twin = [](TwinState state) {
    return [state](Viewer&, view_model::ViewPort& port) { port.twin.store(state); };
  };
  const auto by_twin = [](S& s) { s.method = static_cast<std::uint32_t>(control::Method::kTwin); };
  const auto observes = [](S& s) { s.limit_flags = recording::kLimitObserves; };
  const auto guide = [](ViewFacts& facts) { facts.guide = facts.mouse_is_hand = true; };
  const auto recorded = [](ViewFacts& facts) { facts.recording = "a.h5"; };
  return {
      {"connecting", 0, [](S& s) { s = {}; }},
      {"ready", 1000, [](S& s) { mode(s, Mode::kReady), s.buttons = 0; }},
      {"engaging", 1000, [](S& s) { s.limit_flags = recording::kLimitRamp; }},
      {"free", 800},
      {"attracted", 1400},
      {"contact", 2600},
      {"AFM", 1650, [](S& s) { s.measurement_age_ms = 3; }},
      {"observing", 1650, observes},
      {"stale", 1650, [](S& s) { silent(s, 3.2); }},
      {"lost", 1650, [](S& s) { silent(s, 5.2), mode(s, Mode::kHeld); }},
      {"no answer", 0, [](S& s) { s = {}, s.time_s = 4, s.reply_age_ms = 4000; }},
      {"stopped by a person", 1650, stopped(station::kFaultStopPressed)},
      {"device failed", 1650, stopped(station::kFaultDeviceFailed)},
      {"too fast", 1650, stopped(station::kFaultVelocityTrip)},
      {"stopped observer", 1650,
       [](S& s) { mode(s, Mode::kStopped), s.limit_flags = recording::kLimitObserves; }},
      {"homing", 1650, [](S& s) { mode(s, Mode::kHoming); }},
      {"clutch", 1650, [](S& s) { mode(s, Mode::kReady), s.buttons = device::kButtonClutch; }},
      {"force limit", 2600, [](S& s) { s.limit_flags = recording::kLimitForce; }},
      {"twin confirmed", 1650, by_twin, {}, twin(TwinState::kConfirmed)},
      {"twin apart", 1650, by_twin, {}, twin(TwinState::kApart)},
      {"twin given up", 1650, {}, {}, twin(TwinState::kGivenUp)},
      {"guide", 1400, {}, guide},
      {"measuring", 5000, {}, {}, {}, {GLFW_KEY_L}},
      {"force curve", 2600, {}, {}, {}, {GLFW_KEY_F}},
      {"recording", 1650, {}, recorded},
      {"note", 1650, {}, recorded, {}, {GLFW_KEY_N}},
      {"keys", 1650, {}, {}, {}, {GLFW_KEY_F1}},
      {"ended",
       1650,
       {},
       {},
       [](Viewer& v, view_model::ViewPort&) {
         v.end({true, {"the server has been silent"}});
       }},
      {"ended well",
       1650,
       {},
       {},
       [](Viewer& v, view_model::ViewPort&) {
         v.end({false, {"the task is done", "duration: 10.00 s", "pull-off force: 38.9 nN"}});
       }},
      {"practice link",
       1650,
       {},
       [](ViewFacts& facts) {
         facts.practice = {150, 0, 0.05};
       }},
      {"region", 5000, {}, {}, {}, {GLFW_KEY_Z}},
      {"region of a plane", 2600, {}, {}, {}, {GLFW_KEY_Z}, false},
      {"plane", 2600, {}, {}, {}, {}, false},
      {"overview", 1650, {}, {}, {}, {GLFW_KEY_V}},
      {"getting ready",
       0,
       [](S& s) { s = {}; },
       {},
       [](Viewer& v, view_model::ViewPort&) {
         v.wait("The server's sample is made ready here.", Vec3(300, 300, 40));
       }},
  };
}

class States : public ::testing::Test {
 protected:
  void SetUp() override {
    try {
      context_.emplace();
    } catch (const RunError& error) {
      GTEST_SKIP() << error.what();
    }
  }

  static Picture draw(const State& state) {
    ViewFacts facts = support::view_facts();
    facts.give_up_s = 10;
    if (state.facts) state.facts(facts);
    view_model::ViewPort port;
    Viewer viewer(facts,
                  state.scan ? view_model::Ground(support::view_scan(128))
                             : view_model::Ground(0, Vec3(25, 25, -60), Vec3(575, 575, 100)),
                  port, 1);
    const auto show = [&](const recording::Sample& sample) {
      port.samples.push(sample);
      viewer.take_samples();
    };
    for (std::int64_t tick = 0; tick < state.rows; ++tick) {
      // Measured from where the tip was a while before.
      if (tick == 200 && state.keys == std::vector<int>{GLFW_KEY_L}) press(viewer, GLFW_KEY_L);
      show(support::view_sample(tick));
    }
    recording::Sample last = support::view_sample(state.rows);
    if (state.last) state.last(last);
    show(last);
    if (state.then) state.then(viewer, port);
    for (const int key : state.keys) press(viewer, key);
    return draw_picture(viewer, kWide, kHigh, {12345, false});
  }
  static void press(Viewer& viewer, int key) {
    const Canvas canvas(kWide, kHigh, 0);
    canvas.bind();
    ImGui::GetIO().DeltaTime = 1.0f / 60;
    for (const bool down : {false, true, false}) {
      set_key(key, down);
      viewer.draw(kWide, kHigh, 0, {12345, false});
    }
  }

  std::optional<OffscreenContext> context_;
};

/// The mean of so many points across and down.
void put_small(const Picture& from, Picture& sheet, int number) {
  const int left = number % kAcross * kTileWide;
  const int top = number / kAcross * kTileHigh;
  for (int y = 0; y < kTileHigh; ++y) {
    for (int x = 0; x < kTileWide; ++x) {
      for (int colour = 0; colour < 3; ++colour) {
        int sum = 0;
        for (int v = 0; v < kLess; ++v)
          for (int u = 0; u < kLess; ++u)
            sum += from.rgb[static_cast<std::size_t>(3 * ((y * kLess + v) * kWide + x * kLess + u) + colour)];
        sheet.rgb[static_cast<std::size_t>(3 * ((top + y) * sheet.width_px + left + x) + colour)] =
            static_cast<unsigned char>(sum / (kLess * kLess));
      }
    }
  }
}

// TELENANO_NEW_PICTURES=1 writes the sheet anew; look at it before committing.
TEST_F(States, LookAsTheyDid) {
  const std::vector<State> all = states();
  ASSERT_EQ(all.size(), 35u);
  Picture now{kAcross * kTileWide, (static_cast<int>(all.size()) + kAcross - 1) / kAcross * kTileHigh, {}};
  now.rgb.resize(static_cast<std::size_t>(3 * now.width_px * now.height_px));
  for (std::size_t i = 0; i < all.size(); ++i) {
    const Picture picture = draw(all[i]);
    put_small(picture, now, static_cast<int>(i));
    if (const char* folder = std::getenv("TELENANO_LOOK"))
      write_png(std::string(folder) + "/state_" + all[i].name + ".png", picture);
  }
  const std::string file = std::string(TELENANO_SOURCE_DIR) + "/tests/unit/viewer/states_960x600.png";
  if (std::getenv("TELENANO_NEW_PICTURES") != nullptr) write_png(file, now);
  const Picture before = read_png(file);
  ASSERT_EQ(before.rgb.size(), now.rgb.size());
  for (std::size_t i = 0; i < all.size(); ++i) {
    int far = 0;
    for (int y = 0; y < kTileHigh; ++y) {
      for (int x = 0; x < 3 * kTileWide; ++x) {
        const int row = static_cast<int>(i) / kAcross * kTileHigh + y;
        const auto at = static_cast<std::size_t>(3 * row * now.width_px +
                                                 3 * (static_cast<int>(i) % kAcross) * kTileWide + x);
        far += std::abs(int{now.rgb[at]} - int{before.rgb[at]}) > 40 ? 1 : 0;
      }
    }
    EXPECT_LT(far, 120) << all[i].name << ": " << far << " of " << 3 * kTileWide * kTileHigh;
  }
  // And no two of them are alike, or one would be no state.
  for (std::size_t a = 0; a < all.size(); ++a) {
    for (std::size_t b = a + 1; b < all.size(); ++b) {
      int differ = 0;
      for (int y = 0; y < kTileHigh; ++y) {
        for (int x = 0; x < 3 * kTileWide; ++x) {
          const auto at = [&](std::size_t i) {
            const int row = static_cast<int>(i) / kAcross * kTileHigh + y;
            return now.rgb[static_cast<std::size_t>(3 * row * now.width_px +
                                                    3 * (static_cast<int>(i) % kAcross) * kTileWide + x)];
          };
          differ += std::abs(int{at(a)} - int{at(b)}) > 10 ? 1 : 0;
        }
      }
      EXPECT_GT(differ, 20) << all[a].name << " looks like " << all[b].name;
    }
  }
}

}  // namespace
}  // namespace telenano::viewer
