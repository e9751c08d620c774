// The words of the picture, letter by letter: what they say, and that none lies on another or is cut.
#define GLFW_INCLUDE_NONE
#include <GLFW/glfw3.h>
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <array>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <functional>
#include <limits>
#include <numbers>
#include <optional>

#include "telenano/common/base/error.h"
#include "telenano/master/device/haptic_device.h"
#include "telenano/master/station/station.h"
#include "telenano/master/view_model/session_banner.h"
#include "telenano/master/view_model/status_text.h"
#include "telenano/master/viewer/offscreen.h"
#include "telenano/master/viewer/photographer.h"
#include "telenano/master/viewer/viewer.h"
#include "tests/source_dir.h"
#include "tests/support/view_scene.h"
#include "tests/unit/viewer/glyphs.h"
#include "tests/unit/viewer/render_fixture.h"

namespace telenano::viewer {
namespace {

/// Samples that put the most words on the screen, one after the other.
constexpr int kWordyStates = 8;
recording::Sample wordy(int state) {
  recording::Sample s = support::view_sample(5000 + state);
  if (state >= 5) s.reply_age_ms = 3200;
  if (state == 6) s.station_mode = static_cast<std::uint32_t>(station::Mode::kHeld);
  if (state == 7) {
    s.station_mode = static_cast<std::uint32_t>(station::Mode::kStopped);
    s.station_faults = station::kFaultStopPressed;
    s.limit_flags = recording::kLimitObserves;
    s.measurement_age_ms = 1;
  }
  if (state == 1) s.force_w_nn = {-126.3, 88.8, -101.7};
  if (state == 2) {
    s.tip_pos_w_nm = s.tip_target_w_nm = {300, 300, 115};
    s.station_mode = static_cast<std::uint32_t>(station::Mode::kStopped);
    s.station_faults = station::kFaultStopPressed;
  }
  if (state == 3) s.tip_pos_w_nm = s.tip_target_w_nm = {30, 30, 4};
  if (state == 4) s.rtt_us = 126'000;
  s.particle_pos_w_nm = recording::xyz(Vec3(s.tip_pos_w_nm[0] + 20, s.tip_pos_w_nm[1], 15));
  s.particle_radius_nm = state > 2 ? 20.0 : 0.0;
  s.particle_state = static_cast<std::int64_t>(link::ParticleStatus::kPushed);
  return s;
}

void show(recording::Sample s, view_model::ViewPort& port, Viewer& viewer) {
  for (int i = 0; i < 300; ++i) {
    ++s.tick;
    s.time_s += 1e-3;
    ++s.reply_sequence;
    port.samples.push(s);
  }
  viewer.take_samples();
}

/// Letters of the overview through which a bar or a line of full strength in the words' own colour runs.
std::string crossed(const std::vector<Glyph>& glyphs, const Area& area) {
  const auto inside = [&](float x, float y) { return area.contains(x, y); };
  std::string letters;
  const std::vector<Triangle> lines = drawn_triangles(ink(palette::kText));
  for (const Glyph& g : glyphs) {
    if (!inside(g.x0, g.y0) || !inside(g.x1, g.y1)) continue;
    for (const Triangle& line : lines) {
      if (!meet(line, g)) continue;
      letters.push_back(g.letter < 128 ? static_cast<char>(g.letter) : '?');
      break;
    }
  }
  return letters;
}

// Every letter of the frame as the driver gets it, in the states that put the most words on the screen.
TEST_F(Render, NoWordLiesOnAnotherAtAnySize) {
  facts_.mouse_is_hand = true;
  facts_.give_up_s = 10;
  for (const std::string what : {"scan", "plane", "region"}) {
    make(what != "plane");
    play(0, 5000);
    if (what == "region") press(GLFW_KEY_Z);
    for (int state = 0; state < kWordyStates; ++state) {
      show(wordy(state), port_, *viewer_);
      for (const auto& [wide, high] : {std::pair{640, 480}, {800, 600}, {1280, 800}}) {
        draw_picture(*viewer_, wide, high, {});
        EXPECT_EQ(overlaps(drawn_glyphs(ink(palette::kBackground, 0.75f))), "")
            << what << ", state " << state << ", " << wide << " x " << high;
        if (const char* folder = std::getenv("TELENANO_LOOK")) {
          const Picture look = draw_picture(*viewer_, wide, high, {});
          write_png(
              std::string(folder) + "/" + what + std::to_string(state) + "_" + std::to_string(wide) + ".png",
              look);
        }
      }
    }
  }
}

// The largest screens, of 96 dots an inch and of 192: the same words, none of them cut, in both scales. On the dense one
// every length is twice as many pixels.
TEST_F(Render, NoWordLiesOnAnotherOrIsCutAt4K) {
  constexpr int kWide4K = 3840;
  constexpr int kHigh4K = 2160;
  facts_.mouse_is_hand = true;
  facts_.give_up_s = 10;
  facts_.can_record = true;
  facts_.can_undo = true;
  facts_.practice = link::PracticeLink{};
  facts_.scenes = {"flakes", "flat_pdms", "flat_silicon_oxide"};
  for (const float scale : {1.0f, 2.0f}) {
    viewer_.reset();
    viewer_.emplace(facts_, view_model::Ground(support::view_scan(256)), port_, scale);
    play(0, 5000);
    const Canvas canvas(kWide4K, kHigh4K, 0);
    ImGui::GetIO().DeltaTime = 1.0f / 60;
    float tallest = 0;
    for (int state = 0; state < kWordyStates; ++state) {
      show(wordy(state), port_, *viewer_);
      viewer_->settle(120);
      for (int i = 0; i < 2; ++i) {
        canvas.bind();
        viewer_->draw(kWide4K, kHigh4K, i / 60.0, {});
      }
      const std::vector<Glyph> glyphs = drawn_glyphs(ink(palette::kBackground, 0.75f));
      EXPECT_EQ(overlaps(glyphs), "") << "state " << state << ", scale " << scale;
      std::string cut;
      for (const Glyph& g : glyphs) {
        if (g.cut) cut.push_back(g.letter < 128 ? static_cast<char>(g.letter) : '?');
        tallest = std::max(tallest, g.y1 - g.y0);
      }
      EXPECT_EQ(cut, "") << "state " << state << ", scale " << scale;
      EXPECT_EQ(crossed(glyphs, layout_of(kWide4K, kHigh4K, scale, Views::kBoth).overview), "")
          << "state " << state << ", scale " << scale;
      const std::string text = drawn_text(glyphs);
      EXPECT_NE(text.find(state == 2 || state == 7 ? "Clearthestop(R)" : "STOP(Esc)"), std::string::npos)
          << text;
      EXPECT_NE(text.find("Undothelastmarks(U)"), std::string::npos)
          << "all of the panel is in sight: " << text;
      if (const char* folder = std::getenv("TELENANO_LOOK"); folder != nullptr && (state == 0 || state == 7))
        write_png(fmt::format("{}/4k_{}_{:g}.png", folder, state, scale),
                  {kWide4K, kHigh4K, canvas.read_rgb()});
    }
    EXPECT_NEAR(tallest / scale, 17, 6) << "points, whatever the screen";
  }
}

// The bar on the ground is slanted as the camera looks at it: from every side, at every size, its length stands beside it.
TEST_F(Render, TheBarOnTheGroundRunsThroughNoWords) {
  constexpr std::array<std::pair<int, int>, 4> kSizes = {
      {{640, 480}, {1280, 800}, {1920, 1080}, {3840, 2160}}};
  for (const float scale : {1.0f, 2.0f}) {
    viewer_.reset();
    viewer_.emplace(facts_, view_model::Ground(support::view_scan(256)), port_, scale);
    play(0, 1500);
    for (const auto& [wide, high] : kSizes) {
      if (static_cast<float>(wide) < 640 * scale) continue;
      const Canvas canvas(wide, high, 0);
      const Area area = layout_of(wide, high, scale, Views::kBoth).overview;
      int bars = 0;
      // The overview turned by drags of the right button, all round.
      for (int turn = 0; turn < 24; ++turn) {
        ImGuiIO& io = ImGui::GetIO();
        const auto draw_once = [&] {
          canvas.bind();
          io.DeltaTime = 1.0f / 60;
          viewer_->draw(wide, high, time_s_ += 1.0 / 60, {});
        };
        io.MousePos = {0.7f * static_cast<float>(area.width_px), 0.8f * static_cast<float>(area.height_px)};
        draw_once();
        io.MouseDown[1] = true;
        draw_once();
        io.MousePos.x += 50;  // 15 degrees
        io.MousePos.y += turn % 5 == 4 ? 40.0f : turn % 5 == 2 ? -40.0f : 0.0f;
        draw_once();
        io.MouseDown[1] = false;
        draw_once();
        draw_once();
        const std::vector<Glyph> glyphs = drawn_glyphs(ink(palette::kBackground, 0.75f));
        EXPECT_EQ(crossed(glyphs, area), "") << wide << " x " << high << ", scale " << scale << ", azimuth "
                                             << viewer_->overview_camera().azimuth_deg << ", elevation "
                                             << viewer_->overview_camera().elevation_deg;
        bars += drawn_text(glyphs).find("100nm") != std::string::npos ? 1 : 0;
        if (const char* folder = std::getenv("TELENANO_LOOK"); folder != nullptr && turn % 6 == 0)
          write_png(fmt::format("{}/bar_{}_{}_{:g}.png", folder, turn, wide, scale),
                    {wide, high, canvas.read_rgb()});
      }
      EXPECT_GT(bars, 12) << "or this shows nothing: " << wide << ", scale " << scale;
    }
  }
}

// Letters that lie beyond an edge are not drawn at all, or in part: what a wide window says must be said by
// every other, and no letter may be cut. The numbers are the longest that a session can have.
TEST_F(Render, NoNumberOfThePanelIsCutAtAnySizeAndScale) {
  facts_.mouse_is_hand = false;
  facts_.can_record = true;
  facts_.practice = link::PracticeLink{};
  for (const float scale : {1.0f, 1.5f, 2.0f}) {
    viewer_.reset();
    viewer_.emplace(facts_, view_model::Ground(support::view_scan(64)), port_, scale);
    play(0, 1000);
    recording::Sample s = support::view_sample(1000);
    s.tip_pos_w_nm = {-1234.5, -1234.5, -123.45};
    s.force_w_nn = {-1234.6, -1234.6, -1234.6};
    s.deflection_nm = -12.34;
    s.hand_force_applied_h_n[2] = -11.23;
    s.energy_j = -0.12345;
    s.rtt_us = 123456;
    s.lost = 1234567;
    s.jitter_us = 123456;
    s.force_age_ms = 123.4;
    s.lateness_us = 123.4;
    s.overruns = 1234567;
    port_.samples.push(s);
    port_.contact.store({1.234, 123.4, true});
    viewer_->take_samples();
    // Top and bottom of a panel that scrolls, each without blanks.
    // STOP is in sight wherever it scrolls.
    const auto panel_text = [&](int wide, int high) {
      std::string text;
      std::string cut;
      const Layout where = layout_of(wide, high, scale, Views::kBoth);
      const Canvas canvas(wide, high, 0);
      ImGuiIO& io = ImGui::GetIO();
      for (const float wheel : {100.0f, -100.0f}) {
        for (int i = 0; i < 4; ++i) {
          canvas.bind();
          io.DeltaTime = 1.0f / 60;
          io.MousePos = {static_cast<float>(where.panel.x_px) + 40 * scale,
                         static_cast<float>(high) - 40 * scale};
          io.MouseWheel = i == 1 ? wheel : 0;
          viewer_->draw(wide, high, time_s_ += 1.0 / 60, {});
        }
        std::string shown;
        for (const Glyph& g : drawn_glyphs(ink(palette::kBackground, 0.75f))) {
          if (g.x0 < static_cast<float>(where.panel.x_px)) continue;
          shown.push_back(g.letter < 128 ? static_cast<char>(g.letter) : '?');
          if (g.cut) cut.push_back(shown.back());
        }
        EXPECT_NE(shown.find("STOP(Esc)"), std::string::npos) << shown;
        text += shown + " | ";
        if (const char* folder = std::getenv("TELENANO_LOOK"); folder != nullptr && wheel < 0)
          write_png(fmt::format("{}/panel_{}x{}_{:g}.png", folder, wide, high, scale),
                    {wide, high, canvas.read_rgb()});
      }
      EXPECT_EQ(cut, "") << wide << " x " << high << ", scale " << scale << ": " << text;
      return text;
    };
    for (const auto& [wide, high] : {std::pair{640, 480}, {900, 600}, {1280, 800}}) {
      // The least window of a dense screen has as many of its points.
      const std::string text = panel_text(static_cast<int>(static_cast<float>(wide) * scale),
                                          static_cast<int>(static_cast<float>(high) * scale));
      for (const std::string words :
           {"-1234.5-1234.5-123.45nm", "-1235-1235-1235", "bent-12.3nm", "-11.23of9.6N", "-123.45mJputin",
            "RTT123ms,", "lost1234567", "123ms,", "force123msold", "123?s,", "1234567overruns", "1.23nm"}) {
        EXPECT_NE(text.find(words), std::string::npos)
            << words << ", " << wide << " x " << high << ", scale " << scale << ": " << text;
      }
    }
  }
}

/// Two frames without smoothing, which words do not need: ImGui knows the sizes of its windows after the first.
void draw_plain(Viewer& viewer, int wide, int high, double time_s = 0) {
  const Canvas canvas(wide, high, 0);
  ImGui::GetIO().DeltaTime = 1.0f / 60;
  viewer.settle(120);
  for (int i = 0; i < 2; ++i) {
    canvas.bind();
    viewer.draw(wide, high, time_s + i / 60.0, {});
  }
}

// Every line that a state can have, alone: all of it is in sight in the least window, whatever the size of its words.
TEST_F(Render, EveryMessageIsWholeInTheLeastWindowAtEveryTextSize) {
  struct Case {
    std::string name;
    std::function<void(recording::Sample&)> change;
    device::ForceOffCause cause = device::ForceOffCause::kNone;
    station::TwinState twin = station::TwinState::kNone;
  };
  std::vector<Case> cases;
  const auto mode = [](recording::Sample& s, station::Mode now) {
    s.station_mode = static_cast<std::uint32_t>(now);
  };
  for (std::uint32_t bit = 1; bit != 0 && bit <= 1u << 16; bit <<= 1) {
    cases.push_back({fmt::format("station fault {:#x}", bit), [bit](auto& s) { s.station_faults = bit; }});
    cases.push_back({fmt::format("slave fault {:#x}", bit), [bit](auto& s) { s.fault_bits = bit; }});
    cases.push_back({fmt::format("limit {:#x}", bit), [bit](auto& s) { s.limit_flags = bit; }});
  }
  for (int cause = 1; cause <= static_cast<int>(device::ForceOffCause::kDeviceError); ++cause)
    cases.push_back(
        {fmt::format("device {}", cause), [](auto&) {}, static_cast<device::ForceOffCause>(cause)});
  for (int twin = 0; twin < 6; ++twin)
    cases.push_back({fmt::format("twin {}", twin),
                     [](auto& s) { s.method = static_cast<std::uint32_t>(control::Method::kTwin); },
                     device::ForceOffCause::kNone, static_cast<station::TwinState>(twin)});
  for (int m = 0; m < 6; ++m)
    cases.push_back({fmt::format("mode {}", m), [=](auto& s) { mode(s, static_cast<station::Mode>(m)); }});
  cases.push_back({"silent", [](auto& s) { s.reply_age_ms = 112'345; }});
  facts_.give_up_s = 600;
  for (const double text_size : {1.0, 1.5, 2.0}) {
    make();
    viewer_->set_text_size(text_size);
    const int wide = static_cast<int>(640 * text_size);
    const int high = static_cast<int>(480 * text_size);
    const Area panel = layout_of(wide, high, text_size, Views::kBoth).panel;
    for (const Case& one : cases) {
      SCOPED_TRACE(fmt::format("{}, text {:g}", one.name, text_size));
      recording::Sample s = support::view_sample(1650);
      s.time_s = 200;
      one.change(s);
      port_.force_off.store(one.cause);
      port_.twin.store(one.twin);
      port_.samples.push(s);
      viewer_->take_samples();
      view_model::SessionInputs inputs{s};
      inputs.give_up_s = facts_.give_up_s;
      inputs.twin = one.twin;
      inputs.device_cause = one.cause;
      auto messages = view_model::session_banner(inputs).lines;
      for (auto& message : view_model::slave_text(s.fault_bits)) messages.push_back(message);
      if (messages.empty()) continue;
      draw_plain(*viewer_, wide, high);
      const std::vector<Glyph> glyphs = drawn_glyphs(ink(palette::kBackground, 0.75f));
      EXPECT_EQ(overlaps(glyphs), "");
      // The letters of the panel above what scrolls under the messages, in the order in which they were drawn.
      std::string whole;
      std::string cut;
      for (const Glyph& g : glyphs) {
        if (g.x0 < static_cast<float>(panel.x_px)) continue;
        whole.push_back(g.letter < 128 ? static_cast<char>(g.letter) : '?');
        if (g.cut) cut.push_back(whole.back());
      }
      EXPECT_EQ(cut, "");
      std::string words;
      for (const char c : messages.front().text)
        if (c != ' ') words.push_back(c);
      const auto at = whole.find(words);
      EXPECT_NE(at, std::string::npos) << words << "\n" << whole;
      if (at == std::string::npos) continue;
      std::size_t number = 0;
      for (const Glyph& g : glyphs) {
        if (g.x0 < static_cast<float>(panel.x_px)) continue;
        if (number >= at && number < at + words.size()) {
          EXPECT_FALSE(g.cut_below) << words << ", letter " << number - at;
        }
        ++number;
      }
      if (const char* folder = std::getenv("TELENANO_LOOK"); folder != nullptr && text_size == 1)
        write_png(fmt::format("{}/message_{}.png", folder, one.name), draw_picture(*viewer_, wide, high, {}));
    }
  }
}

// What is said for a few seconds is whole, whatever its length, and lies on no other words, in each of the pictures.
TEST_F(Render, WhatIsSaidForAMomentIsWholeAndLiesOnNoOtherWords) {
  const std::string folder = "/home/somebody/measurements/2026/a very long name of a folder/";
  const std::vector<std::string> all = {
      "Text 100 %",
      folder +
          "telenano-1.png: the picture cannot be written: Permission denied; check the folder, its "
          "permissions and "
          "its free space",
      "The server does not have that sample, or no place at it now: the session goes on at this one",
      folder + std::string(4000, 'w')};
  for (const double text_size : {1.0, 1.5, 2.0}) {
    make();
    viewer_->set_text_size(text_size);
    const int wide = static_cast<int>(640 * text_size);
    const int high = static_cast<int>(480 * text_size);
    for (const int state : {7}) {
      show(wordy(state), port_, *viewer_);
      for (const Views views : {Views::kBoth, Views::kOverview, Views::kCloseUp}) {
        viewer_->show(views);
        for (const std::string& words : all) {
          viewer_->say(words, 0);
          draw_plain(*viewer_, wide, high);
          const std::vector<Glyph> glyphs = drawn_glyphs(ink(palette::kBackground, 0.75f));
          SCOPED_TRACE(fmt::format("state {}, text {:g}, views {}, '{}'", state, text_size,
                                   static_cast<int>(views), words.substr(0, 20)));
          EXPECT_EQ(overlaps(glyphs), "");
          std::string cut;
          for (const Glyph& g : glyphs)
            if (g.cut) cut.push_back(g.letter < 128 ? static_cast<char>(g.letter) : '?');
          EXPECT_EQ(cut, "");
          std::string expected;
          for (const char c : words.substr(0, 400))
            if (c != ' ') expected.push_back(c);
          EXPECT_NE(drawn_text(glyphs).find(expected), std::string::npos) << drawn_text(glyphs);
          if (const char* look = std::getenv("TELENANO_LOOK"); look != nullptr && text_size == 1)
            write_png(fmt::format("{}/said_{}_{}_{}.png", look, state, static_cast<int>(views), words.size()),
                      draw_picture(*viewer_, wide, high, {}));
        }
      }
    }
  }
}

// Why the server's scene is not used, or not yet: said, and in short as long as it is so.
TEST_F(Render, WhatIsWrongWithTheServersSceneIsSaidAndStaysInShort) {
  make();
  play(0, 5000);
  const auto text = [&](double time_s) {
    draw_plain(*viewer_, 1280, 800, time_s);
    const std::vector<Glyph> glyphs = drawn_glyphs(ink(palette::kBackground, 0.75f));
    EXPECT_EQ(overlaps(glyphs), "");
    return drawn_text(glyphs);
  };
  const auto count = [](const std::string& shown, const std::string& words) {
    int found = 0;
    for (auto at = shown.find(words); at != std::string::npos; at = shown.find(words, at + 1)) ++found;
    return found;
  };
  const view_model::ServerScene slow{10, "the check goes on", "still being checked"};
  viewer_->set_server_scene(slow, 0);
  EXPECT_EQ(count(text(0), "thecheckgoeson"), 1);
  EXPECT_EQ(count(text(60), "thecheckgoeson"), 0) << "said once";
  viewer_->set_server_scene(slow, 60);
  const std::string later = text(60);
  EXPECT_EQ(count(later, "thecheckgoeson"), 0) << "and not again";
  EXPECT_EQ(count(later, "stillbeingchecked"), 1);
  viewer_->set_server_scene({10, "", ""}, 61);
  EXPECT_EQ(count(text(61), "stillbeingchecked"), 0);
  viewer_->set_server_scene({0, "it is damaged", "cannot be used"}, 62);
  const std::string damaged = text(62);
  EXPECT_EQ(count(damaged, "itisdamaged"), 1) << damaged;
  EXPECT_EQ(count(damaged, "cannotbeused"), 1) << damaged;
}

// The largest words of the tip's radius fit into the narrowest section.
TEST_F(Render, TheTipsRadiusIsSaidWithWhereItIsFrom) {
  const auto text = [&](int wide, int high) {
    draw_plain(*viewer_, wide, high);
    const std::vector<Glyph> glyphs = drawn_glyphs(ink(palette::kBackground, 0.75f));
    EXPECT_EQ(overlaps(glyphs), "");
    for (const Glyph& g : glyphs) EXPECT_FALSE(g.cut) << static_cast<char>(g.letter);
    return drawn_text(glyphs);
  };
  facts_.scene = {};
  for (const auto& [wide, high] : {std::pair{640, 480}, {1000, 640}, {1280, 800}}) {
    facts_.tip_radius_given_nm = 0;
    make();
    play(0, 5000);
    EXPECT_NE(text(wide, high).find("tipradiusdrawn:20nm(assumed)"), std::string::npos) << wide;
    viewer_->set_server_scene({10, "", ""}, 0);
    const std::string known = text(wide, high);
    EXPECT_NE(known.find("tipradiusdrawn:10nm"), std::string::npos) << known;
    EXPECT_EQ(known.find("assumed"), std::string::npos) << known;
    facts_.tip_radius_given_nm = 1234;
    make();
    play(0, 5000);
    viewer_->set_server_scene({10.5, "", ""}, 0);
    EXPECT_NE(text(wide, high).find("tipradiusdrawn:1234nm(thescene's:10.5nm)"), std::string::npos) << wide;
  }
}

// A recording that has failed is told as such, once in the picture and then in the panel, and nothing is said to be put into it.
TEST_F(Render, ARecordingThatHasFailedTakesNoMarksAndNoNotes) {
  facts_.recording = "a.h5";
  make();
  play(0, 100);
  const RecordingStatus failed{1000, true, "a.h5: cannot be written: No space left on device"};
  const auto text = [&] {
    draw_picture(*viewer_, 1280, 800, failed);
    return drawn_text(drawn_glyphs(ink(palette::kBackground, 0.75f)));
  };
  const auto has = [](const std::string& shown, const std::string& words) {
    return shown.find(words) != std::string::npos;
  };
  std::string shown = text();
  EXPECT_TRUE(
      has(shown, "Therecordinghasfailed,andthesessiongoeson:a.h5:cannotbewritten:Nospaceleftondevice"))
      << shown;
  EXPECT_TRUE(has(shown, "recordinghasfaileda.h5:cannotbewritten")) << shown;
  EXPECT_EQ(overlaps(drawn_glyphs(ink(palette::kBackground, 0.75f))), "");
  for (const int key : {GLFW_KEY_M, GLFW_KEY_N}) {
    set_key(key, true);
    text();
    set_key(key, false);
    shown = text();
    EXPECT_TRUE(has(shown, "canbeputintoit")) << shown;
    EXPECT_FALSE(has(shown, "putintotherecording")) << shown;
    EXPECT_FALSE(viewer_->writes_note());
  }
}

// Words grow as far as the window has room for all of them: in the least window not at all.
TEST_F(Render, WordsAreAsLargeAsAskedForAndLieOnNoOthers) {
  facts_.mouse_is_hand = true;
  facts_.can_record = true;
  facts_.recording.clear();
  make();
  play(0, 5000);
  const auto tallest = [&](int wide, int high) {
    draw_picture(*viewer_, wide, high, {});
    const std::vector<Glyph> glyphs = drawn_glyphs(ink(palette::kBackground, 0.75f));
    EXPECT_EQ(overlaps(glyphs), "") << wide << " x " << high << ", text " << viewer_->text_size();
    float most = 0;
    for (const Glyph& g : glyphs) most = std::max(most, g.y1 - g.y0);
    return most;
  };
  const float least = tallest(640, 480);
  const float first = tallest(1280, 960);
  EXPECT_NEAR(first, least, 1);
  viewer_->set_text_size(1.5);
  EXPECT_NEAR(tallest(1280, 960), 1.5 * first, 2);
  EXPECT_NEAR(tallest(640, 480), least, 1);
  viewer_->set_text_size(9);
  EXPECT_NEAR(tallest(1280, 960), 2 * first, 2) << "twice 640 x 480";
}

// What is told in the picture, read back letter by letter.
TEST_F(Render, TellsWhatAPersonHasToKnow) {
  facts_.mouse_is_hand = true;
  facts_.give_up_s = 10;
  facts_.surface_doubt = "not the scan of 'flakes'";
  make();
  play(0, 1500);
  recording::Sample s = support::view_sample(1500);
  s.force_w_nn = {12.6, -0.1, 1.7};
  const auto shown = [&] {
    s.time_s += 1e-3;
    ++s.tick;
    port_.samples.push(s);
    viewer_->take_samples();
    draw_picture(*viewer_, 640, 480, {});
    return drawn_text(drawn_glyphs(ink(palette::kBackground, 0.75f)));
  };
  const auto has = [](const std::string& text, const std::string& words) {
    return text.find(words) != std::string::npos;
  };
  std::string text = shown();
  EXPECT_TRUE(has(text, "push12.7nN")) << text;
  EXPECT_TRUE(has(text, "x+12.6y-0.1z+1.7nN")) << text;
  EXPECT_TRUE(has(text, "notthescanof'flakes'")) << text;
  EXPECT_TRUE(has(text, "SIM"));
  EXPECT_FALSE(has(text, "STALE"));
  EXPECT_FALSE(has(text, "Observing"));
  s.limit_flags = recording::kLimitObserves;
  text = shown();
  EXPECT_TRUE(has(text, "Observing:thetipisanothersession's")) << text;
  s.limit_flags = 0;
  s.reply_age_ms = 3200;
  s.time_s = 60;
  text = shown();
  EXPECT_TRUE(has(text, "STALE3.2s,7sleft")) << text;
  EXPECT_TRUE(has(text, "3.2sold")) << text;
  EXPECT_TRUE(has(text, "thesessionendsin7s")) << text;
  s.reply_age_ms = 1;
  shown();
  // The hand's box: 55 nm at this scale.
  ImGuiIO& io = ImGui::GetIO();
  const Area area = layout().close_up;
  io.MousePos = {static_cast<float>(area.x_px + 60), static_cast<float>(area.y_px + 60)};
  frame();
  io.MouseDown[0] = true;
  frame();
  for (int i = 0; i < 20; ++i) {
    io.MousePos.x += 300;
    frame();
  }
  text = drawn_text(drawn_glyphs(ink(palette::kBackground, 0.75f)));
  EXPECT_TRUE(has(text, "byatmost55.0nm")) << text;
  io.MouseDown[0] = false;
  frame();
  viewer_->end({true, {"the server at 127.0.0.1:5100 has been silent for 10 s", "after 63.0 s"}});
  text = shown();
  EXPECT_TRUE(has(text, "Thesessionhasended")) << text;
  EXPECT_TRUE(has(text, "hasbeensilentfor10s")) << text;
  EXPECT_FALSE(has(text, "STOP")) << text;
  while (asked()) {
  }
  press(GLFW_KEY_ESCAPE);
  EXPECT_FALSE(asked() || stop_asked()) << "there is nobody to ask";
  set_modifiers(GLFW_MOD_CONTROL);
  press(GLFW_KEY_Q);
  set_modifiers(0);
  EXPECT_TRUE(viewer_->quit_wanted());
}

// Down in 2 s and the same way up: the pull is 3 nN at the surface, 0.06 nN less a step of the tip farther
// (at most 25 pm a row, exp(-0.025/2)), and nothing is lost but what the grid's heights differ from the
// formula.
TEST_F(Render, FShowsForceOverDistanceWithNumbers) {
  make();
  const auto text = [&] {
    draw_picture(*viewer_, 1280, 800, {});
    return drawn_text(drawn_glyphs(ink(palette::kBackground, 0.75f)));
  };
  const auto has = [](const std::string& shown, const std::string& words) {
    return shown.find(words) != std::string::npos;
  };
  EXPECT_FALSE(has(text(), "overdistance"));
  press(GLFW_KEY_F);
  EXPECT_TRUE(has(text(), "Force[nN]overdistance[nm]"));
  EXPECT_TRUE(has(text(), "notouchyet"));
  play(0, 2000);
  EXPECT_TRUE(has(text(), "retract:tocome")) << text();
  for (std::int64_t i = 0; i < 2000; ++i) {
    recording::Sample s = support::view_sample(2000 - i);
    s.tick = 2000 + i;
    s.time_s = 1e-3 * static_cast<double>(s.tick);
    s.reply_sequence = s.tick + 1;
    port_.samples.push(s);
  }
  viewer_->take_samples();
  const std::string shown = text();
  EXPECT_TRUE(has(shown, "approach:mostpull")) << shown << ": a lever this stiff does not leap";
  EXPECT_TRUE(has(shown, "retract:pull-off")) << shown;
  const auto at = shown.find("retract:pull-off");
  ASSERT_NE(at, std::string::npos);
  EXPECT_NEAR(std::strtod(shown.c_str() + at + std::string("retract:pull-off").size(), nullptr), -3, 0.06)
      << shown;
  EXPECT_TRUE(has(shown, "lost0.0aJ")) << shown;
  EXPECT_FALSE(viewer_->take_data_wanted());
  press(GLFW_KEY_D);
  EXPECT_TRUE(viewer_->take_data_wanted());
  EXPECT_FALSE(viewer_->take_data_wanted()) << "once";
  EXPECT_NE(viewer_->data().find("# pull-off: -"), std::string::npos);
  if (const char* folder = std::getenv("TELENANO_LOOK")) {
    for (const auto& [wide, high] : {std::pair{640, 480}, {1280, 800}})
      write_png(std::string(folder) + "/force_" + std::to_string(wide) + ".png",
                draw_picture(*viewer_, wide, high, {}));
  }
  press(GLFW_KEY_F);
  EXPECT_FALSE(has(text(), "overdistance"));
}

// From the least window to 4K, at the scales of a screen.
TEST_F(Render, WordsOfTheForceCurveLieOnNoOthersAtAnySizeAndScale) {
  for (const float scale : {1.0f, 1.5f, 2.0f}) {
    viewer_.reset();
    viewer_.emplace(facts_, view_model::Ground(support::view_scan(256)), port_, scale);
    viewer_->show_force_curve(true);
    play(0, 2000);
    for (const auto& [wide, high] : {std::pair{640, 480}, {1280, 800}, {3840, 2160}}) {
      const Canvas canvas(wide, high, 0);
      canvas.bind();
      ImGui::GetIO().DeltaTime = 1.0f / 60;
      for (int i = 0; i < 2; ++i) viewer_->draw(wide, high, i / 60.0, {});
      EXPECT_EQ(overlaps(drawn_glyphs(ink(palette::kBackground, 0.75f))), "")
          << wide << " x " << high << ", scale " << scale;
    }
  }
}

}  // namespace
}  // namespace telenano::viewer
