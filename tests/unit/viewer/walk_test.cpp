// A person who means ill or is tired: every key in every state, the mouse everywhere, windows of any size, all at once.
// Nothing may crash or leave a fault of OpenGL's behind, and nothing may be asked of the loop that the state forbids.
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "telenano/common/base/random.h"
#include "telenano/master/view_model/playback.h"
#include "tests/unit/viewer/render_fixture.h"

namespace telenano::viewer {
namespace {

using Kind = ViewRequest::Kind;

class Walk : public Render {
 protected:
  void begin() {
    facts_.can_undo = facts_.can_record = true;
    facts_.scenes = {facts_.scene_name, "flat PDMS", "flakes"};
    facts_.tasks = {{"indent", "down and up", Vec3(0, 0, 20), false},
                    {"scratch", "too far for any hand", Vec3(1e6, 0, 0), false},
                    {"free hand", "your mouse leads it", Vec3::Zero(), true}};
    facts_.hand_box_half_m = Vec3::Constant(0.055);
    facts_.practice = link::PracticeLink{};
    make(false);
    viewer_->begin(facts_);
  }
  void show(const recording::Sample& sample) {
    port_.samples.push(sample);
    viewer_->take_samples();
  }
  void draw_at(int wide, int high) {
    auto& canvas = canvases_[{wide, high}];
    if (!canvas) canvas.emplace(wide, high, 0);
    canvas->bind();
    ImGui::GetIO().DeltaTime = 1.0f / 60;
    viewer_->draw(wide, high, time_s_ += 1.0 / 60, {});
  }
  std::map<std::pair<int, int>, std::optional<Canvas>> canvases_;

  /// What was asked since the last call, one letter each; what is out of range is told at once.
  std::string requests() {
    std::string asked_for;
    while (const auto request = asked()) {
      switch (request->kind) {
        case Kind::kClearStop:
          asked_for += 'r';
          break;
        case Kind::kMethod:
          EXPECT_TRUE(facts_.method_offered[static_cast<std::size_t>(request->method)]);
          asked_for += 'c';
          break;
        case Kind::kScaling: {
          const control::Scaling& s = request->scaling;
          EXPECT_TRUE(std::isfinite(s.velocity) && std::isfinite(s.force)) << s.velocity << ' ' << s.force;
          EXPECT_LE(s.impedance(), 30 * (1 + 1e-9)) << "beyond the safe region";
          asked_for += 'a';
          break;
        }
        case Kind::kMarker:
          asked_for += 'm';
          break;
        case Kind::kTask:
          EXPECT_TRUE(request->task == 0 || request->task == 2) << request->task;
          asked_for += 't';
          break;
        case Kind::kUndo:
          asked_for += 'u';
          break;
        case Kind::kPractice:
          asked_for += 'p';
          break;
        case Kind::kScene:
          EXPECT_TRUE(request->scene == 1 || request->scene == 2) << request->scene;
          asked_for += 's';
          break;
      }
    }
    return asked_for;
  }
};

// One key a frame, by itself, with Ctrl and with Shift: whatever is asked fits the state that is seen.
TEST_F(Walk, EveryKeyInEveryStateAsksOnlyWhatThatStateAllows) {
  struct Reached {
    const char* name;
    std::function<void()> enter;
    std::string never;  ///< of requests()
    bool stops = true;  ///< Esc is a STOP that somebody hears
  };
  const std::string all = "rcamtups";
  recording::Sample s = support::view_sample(800);
  s.contact_state = static_cast<std::uint32_t>(link::ContactState::kFree);
  const auto with = [&](const std::function<void(recording::Sample&)>& change) {
    return [&, change] {
      recording::Sample now = s;
      change(now);
      show(now);
    };
  };
  std::vector<recording::Sample> rows;
  for (int i = 0; i < 2000; ++i) rows.push_back(support::view_sample(i));
  view_model::Playback playback(rows, {{1, "mark 1"}});
  const std::vector<Reached> states = {
      {"engaged", with([](auto&) {}), ""},
      {"in contact", with([](auto& now) { now.contact_state = 3; }), "u"},
      {"stopped", with([](auto& now) {
         now.station_mode = static_cast<std::uint32_t>(station::Mode::kStopped);
         now.fault_bits = link::kFaultRetracted;
       }),
       "u"},
      {"lost", with([](auto& now) {
         now.station_mode = static_cast<std::uint32_t>(station::Mode::kHeld);
         now.reply_age_ms = 5000;
       }),
       ""},
      {"observing", with([](auto& now) { now.limit_flags = recording::kLimitObserves; }), "u"},
      {"nothing heard yet", with([](auto& now) {
         now = {};
         now.station_mode = static_cast<std::uint32_t>(station::Mode::kIdle);
       }),
       ""},
      {"guide",
       [&] {
         facts_.guide = true;
         begin();
         show(s);
       },
       ""},
      {"waiting for another sample", [&] { viewer_->wait("on its way", Vec3(300, 300, 40)); }, all, false},
      {"ended",
       [&] {
         show(s);
         viewer_->end({true, {"the server has been silent"}});
       },
       all, false},
      {"recording",
       [&] {
         facts_.played = "a.h5";
         make(false);
         viewer_->play(playback);
       },
       all, false},
  };
  for (const Reached& state : states) {
    SCOPED_TRACE(state.name);
    facts_ = support::view_facts();
    begin();
    state.enter();
    draw_at(160, 120);
    requests();
    stop_asked();
    ImGuiIO& io = ImGui::GetIO();
    std::string seen;
    for (const int mods : {0, 1, 2}) {
      for (int key = GLFW_KEY_SPACE; key <= GLFW_KEY_LAST; ++key) {
        if (key > GLFW_KEY_GRAVE_ACCENT && key < GLFW_KEY_ESCAPE) continue;
        if (key >= GLFW_KEY_LEFT_SHIFT) break;
        set_key(key, true);
        set_modifiers(mods == 1 ? GLFW_MOD_CONTROL : mods == 2 ? GLFW_MOD_SHIFT : 0);
        if (mods != 1 && key < 127) io.AddInputCharacter(static_cast<unsigned>(key));
        draw_at(160, 120);
        set_key(key, false);
        const std::string now = requests();
        seen += now;
        for (const char one : now)
          EXPECT_EQ(state.never.find(one), std::string::npos) << one << " by key " << key << ", " << mods;
        const bool stop = stop_asked();
        if (key == GLFW_KEY_ESCAPE && state.stops) {
          EXPECT_TRUE(stop) << "whatever else is open";
        }
        if (key != GLFW_KEY_ESCAPE || state.never == all) {
          EXPECT_EQ(stop, key == GLFW_KEY_ESCAPE && std::string(state.name).starts_with("waiting")) << key;
        }
        EXPECT_EQ(port_.quit.exchange(false),
                  mods == 1 && key == GLFW_KEY_Q &&
                      (state.never != all || std::string(state.name).starts_with("waiting")))
            << key;
        if (state.never == all) {
          EXPECT_FALSE(viewer_->take_record_wanted()) << "of what is over, or not there yet";
        }
        viewer_->take_record_wanted();
        viewer_->take_data_wanted();
        viewer_->take_picture_wanted();
      }
    }
    set_modifiers(0);
    draw_at(160, 120);
    EXPECT_EQ(glGetError(), static_cast<GLenum>(GL_NO_ERROR));
    if (state.never.empty()) {
      EXPECT_NE(seen.find('c'), std::string::npos) << "a method can be chosen: " << seen;
      EXPECT_NE(seen.find('m'), std::string::npos) << seen;
    }
  }
}

// What was said of a key is true: a mark after the end is none.
TEST_F(Walk, NothingIsSaidToBePutIntoARecordingThatIsClosed) {
  facts_.recording = "a.h5";
  begin();
  play(0, 100);
  viewer_->end({false, {"the task is done"}});
  for (const int key : {GLFW_KEY_M, GLFW_KEY_N}) {
    press(key);
    draw_picture(*viewer_, 1280, 800, {});
    const std::string text = drawn_text(drawn_glyphs(ink(palette::kBackground, 0.75f)));
    EXPECT_NE(text.find("itsrecordingisclosed"), std::string::npos) << text;
    EXPECT_EQ(text.find("Markputinto"), std::string::npos) << text;
    EXPECT_FALSE(viewer_->writes_note());
  }
}

// The practice link is as a person has made it, also at the sample after.
TEST_F(Walk, ThePracticeLinkStaysOverAnotherSample) {
  begin();
  play(0, 100);
  ImGuiIO& io = ImGui::GetIO();
  for (int i = 0; i < 3; ++i) frame();
  // The slider of the round trip, wherever it stands: over the panel until one is asked.
  std::optional<link::PracticeLink> asked_for;
  for (int y = 100; y < kHeight && !asked_for; y += 6) {
    io.MousePos = {kWidth - 180.0f, static_cast<float>(y)};
    frame();
    io.MouseDown[0] = true;
    frame();
    io.MouseDown[0] = false;
    frame();
    while (const auto request = asked())
      if (request->kind == Kind::kPractice) asked_for = request->practice;
  }
  ASSERT_TRUE(asked_for);
  const std::string before = viewer_->practice_text();
  ASSERT_NE(before, "");
  viewer_->wait("on its way", Vec3(300, 300, 40));
  frame();
  viewer_->begin(facts_);
  play(0, 100);
  frame();
  EXPECT_EQ(viewer_->practice_text(), before);
}

// As small as a window can be made, and back: the picture is what it was.
TEST_F(Walk, AWindowOfOnePointAndBackIsAsBefore) {
  begin();
  play(0, 3000);
  const Picture before = draw_picture(*viewer_, 640, 480, {});
  for (const auto& [wide, high] :
       {std::pair{1, 1}, {1, 900}, {1400, 1}, {2, 2}, {7, 480}, {640, 3}, {33, 21}, {236, 118}, {240, 120}}) {
    SCOPED_TRACE(fmt::format("{} x {}", wide, high));
    for (int i = 0; i < 3; ++i) draw_at(wide, high);
    EXPECT_EQ(glGetError(), static_cast<GLenum>(GL_NO_ERROR));
    const Layout l = layout_of(wide, high, 1, Views::kBoth);
    for (const Area& area : {l.overview, l.close_up, l.charts[0], l.charts[3], l.panel}) {
      EXPECT_GE(area.width_px, 0);
      EXPECT_GE(area.height_px, 0);
    }
  }
  const Picture after = draw_picture(*viewer_, 640, 480, {});
  ASSERT_EQ(before.rgb.size(), after.rgb.size());
  std::size_t differ = 0;
  for (std::size_t i = 0; i < before.rgb.size(); ++i) differ += before.rgb[i] != after.rgb[i] ? 1 : 0;
  EXPECT_LT(differ, before.rgb.size() / 1000) << "but for what blinks";
}

// Keys, buttons, wheel, sizes, samples of any kind and the turns of a session, all by chance.
TEST_F(Walk, AMonkeyAtTheWindowDoesNoHarm) {
  const double bad = std::numeric_limits<double>::quiet_NaN();
  constexpr int kFrames = 1200;
  for (const std::uint64_t seed : {1, 2, 3}) {
    SCOPED_TRACE(seed);
    facts_ = support::view_facts();
    facts_.mouse_is_hand = seed == 2;
    facts_.recording = seed == 3 ? "a.h5" : "";
    begin();
    Random random(seed);
    ImGuiIO& io = ImGui::GetIO();
    const std::array<std::pair<int, int>, 6> sizes = {
        {{320, 240}, {320, 240}, {640, 480}, {1, 1}, {900, 2}, {60, 300}}};
    std::pair<int, int> size = sizes[0];
    bool ended = false;
    bool waiting = false;
    std::int64_t tick = 0;
    for (int i = 0; i < kFrames; ++i) {
      if (random.chance(0.02)) size = sizes[random.below(sizes.size())];
      for (int k = 0; k < 3; ++k) {
        const int key = GLFW_KEY_SPACE + static_cast<int>(random.below(GLFW_KEY_LEFT_SHIFT - GLFW_KEY_SPACE));
        if (key > GLFW_KEY_GRAVE_ACCENT && key < GLFW_KEY_ESCAPE) continue;
        set_key(key, random.chance(0.5));
      }
      const int ctrl = random.chance(0.2) ? GLFW_MOD_CONTROL : 0;
      set_modifiers(ctrl | (random.chance(0.2) ? GLFW_MOD_SHIFT : 0));
      if (random.chance(0.3))
        io.AddInputCharacter(
            static_cast<unsigned>(random.chance(0.9) ? 32 + random.below(95) : random.below(0x11000)));
      if (random.chance(0.5))
        io.MousePos = {static_cast<float>(random.uniform(-20, size.first + 20)),
                       static_cast<float>(random.uniform(-20, size.second + 20))};
      for (int b = 0; b < 3; ++b)
        if (random.chance(0.2)) io.MouseDown[b] = !io.MouseDown[b];
      io.MouseWheel = random.chance(0.1) ? static_cast<float>(random.uniform(-50, 50)) : 0;
      if (random.chance(0.02)) viewer_->note_press({static_cast<float>(random.uniform(-1e4, 1e4)), 0});
      recording::Sample s = support::view_sample(tick += static_cast<std::int64_t>(random.below(30)));
      s.station_mode = static_cast<std::uint32_t>(random.below(9));
      s.contact_state = static_cast<std::uint32_t>(random.below(5));
      s.limit_flags = random.chance(0.2) ? std::uint32_t{recording::kLimitObserves} : 0u;
      if (random.chance(0.2)) s.station_faults = static_cast<std::uint32_t>(random.below(1u << 16));
      if (random.chance(0.2)) s.fault_bits = static_cast<std::uint32_t>(random.below(1u << 12));
      if (random.chance(0.1)) s.reply_age_ms = random.uniform(0, 1e5);
      if (random.chance(0.05)) s.force_w_nn = {bad, 1e300, -1e300};
      if (random.chance(0.05)) s.tip_pos_w_nm = {bad, bad, bad};
      if (random.chance(0.02)) s.velocity_scale = random.chance(0.5) ? 0 : bad;
      if (random.chance(0.02)) s.force_scale = random.chance(0.5) ? -1 : bad;
      port_.samples.push(s);
      port_.twin.store(static_cast<station::TwinState>(random.below(6)));
      if (random.chance(0.1))
        port_.undo.store({static_cast<view_model::UndoText>(random.below(6)), static_cast<std::uint32_t>(i)});
      if (random.chance(0.1))
        port_.scene.store(
            {static_cast<view_model::SceneText>(random.below(7)), static_cast<std::uint32_t>(i)});
      port_.task.store({static_cast<int>(random.below(3)), random.chance(0.5), random.uniform(0, 9),
                        random.chance(0.5) ? 9 : HUGE_VAL});
      if (!ended && random.chance(0.003)) {
        viewer_->wait("on its way", Vec3(random.uniform(0, 600), 0, 40));
        waiting = true;
      }
      if (waiting && random.chance(0.05)) {
        viewer_->begin(facts_);
        waiting = false;
      }
      if (!ended && !waiting && i > kFrames - 300 && random.chance(0.02)) {
        viewer_->end({random.chance(0.5), {"over"}});
        ended = true;
      }
      if (random.chance(0.01))
        viewer_->set_ground(random.chance(0.5)
                                ? view_model::Ground(support::view_scan(16))
                                : view_model::Ground(0, Vec3(25, 25, -60), Vec3(575, 575, 100)));
      viewer_->take_samples();
      draw_at(size.first, size.second);
      const std::string now = requests();
      if (ended || waiting) {
        EXPECT_EQ(now, "");
      }
      view_model::Note note;
      while (port_.notes.pop(note)) EXPECT_EQ(note.text.back(), 0);
      ASSERT_EQ(glGetError(), static_cast<GLenum>(GL_NO_ERROR)) << "frame " << i;
      ASSERT_TRUE(std::isfinite(viewer_->overview_camera().distance_nm) &&
                  viewer_->overview_camera().distance_nm > 0)
          << i;
      ASSERT_TRUE(viewer_->hand().hand_pos_h_m().allFinite()) << i;
    }
    // A scan, a sample, and all is in sight again.
    for (int key = 0; key <= GLFW_KEY_LAST; ++key) set_key(key, false);
    for (bool& down : io.MouseDown) down = false;
    set_modifiers(0);
    draw_at(640, 480);
    EXPECT_EQ(glGetError(), static_cast<GLenum>(GL_NO_ERROR));
  }
}

}  // namespace
}  // namespace telenano::viewer
