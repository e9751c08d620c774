// What leads a person: the guide to a first touch, the start screen, keys for all that a mouse can do.
#define GLFW_INCLUDE_NONE
#include <GLFW/glfw3.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>
#include <optional>
#include <string>

#include "telenano/common/base/error.h"
#include "telenano/master/station/station.h"
#include "telenano/master/viewer/keys.h"
#include "telenano/master/viewer/offscreen.h"
#include "telenano/master/viewer/photographer.h"
#include "telenano/master/viewer/start_screen.h"
#include "telenano/master/viewer/viewer.h"
#include "tests/support/view_scene.h"
#include "tests/unit/viewer/glyphs.h"

namespace telenano::viewer {
namespace {

using view_model::ViewRequest;

class Guidance : public ::testing::Test {
 protected:
  void SetUp() override {
    try {
      context_.emplace();
    } catch (const RunError& error) {
      GTEST_SKIP() << error.what();
    }
    facts_ = support::view_facts();
  }
  void make(float scale) {
    viewer_.reset();
    viewer_.emplace(facts_, view_model::Ground(support::view_scan(256)), port_, scale);
  }
  void play(std::int64_t from, std::int64_t to) {
    for (std::int64_t tick = from; tick < to; ++tick) {
      recording::Sample s = support::view_sample(tick);
      s.method = static_cast<std::uint32_t>(control::Method::kTwin);
      port_.samples.push(s);
      if (tick % 4000 == 0) viewer_->take_samples();
    }
    viewer_->take_samples();
  }
  void frames(int wide, int high, int count) {
    const Canvas canvas(wide, high, 0);
    canvas.bind();
    for (int i = 0; i < count; ++i) {
      ImGui::GetIO().DeltaTime = 1.0f / 60;
      viewer_->draw(wide, high, time_s_ += 1.0 / 60, {});
    }
  }
  void frame() { frames(1280, 800, 1); }
  void press(int key) {
    set_key(key, true);
    frame();
    set_key(key, false);
    frame();
  }
  static std::vector<Glyph> glyphs() { return drawn_glyphs(ink(palette::kBackground, 0.75f)); }
  static bool says(const std::string& words) { return drawn_text(glyphs()).find(words) != std::string::npos; }
  /// To look at, where TELENANO_LOOK names a folder.
  void look(const std::string& name, int wide, int high) {
    const char* const folder = std::getenv("TELENANO_LOOK");
    if (folder != nullptr)
      write_png(std::string(folder) + "/" + name + "_" + std::to_string(wide) + ".png",
                draw_picture(*viewer_, wide, high, {}));
  }

  std::optional<OffscreenContext> context_;
  ViewFacts facts_;
  view_model::ViewPort port_;
  std::optional<Viewer> viewer_;
  double time_s_ = 0;
};

// In every step, from the least window to 4K, at the scales of a screen.
TEST_F(Guidance, WordsOfTheGuideAndTheTwinLieOnNoOthers) {
  facts_.guide = true;
  facts_.mouse_is_hand = true;
  for (const float scale : {1.0f, 2.0f}) {
    make(scale);
    std::int64_t tick = 0;
    for (const std::int64_t to : {20, 1400, 1650, 1720, 2600}) {
      play(tick, to);
      tick = to;
      port_.twin.store(to > 1700 ? station::TwinState::kApart : station::TwinState::kConfirmed);
      for (const auto& [wide, high] : {std::pair{640, 480}, {1280, 800}, {3840, 2160}}) {
        if (wide > 2000 && to != 1720) continue;  // half a minute of drawing
        frames(wide, high, 2);
        EXPECT_EQ(overlaps(glyphs()), "")
            << "row " << to << ", " << wide << " x " << high << ", scale " << scale;
        // A screen of 320 x 240 at that scale has no room for it.
        const bool room = static_cast<float>(wide) > 639 * scale;
        EXPECT_TRUE(says("Firsttouch,step") || !room) << drawn_text(glyphs());
        if (scale == 1) look("guide" + std::to_string(to), wide, high);
      }
    }
    EXPECT_TRUE(says("step5of5")) << drawn_text(glyphs());
    frames(1280, 800, 1);
    EXPECT_TRUE(says("Twinapart"));
  }
}

// A twin of one's own touches nothing while another's tip is seen in contact.
TEST_F(Guidance, WhoLooksOnWithATwinReadsNoContactOfItsOwn) {
  make(1);
  recording::Sample s = support::view_sample(1650);
  s.contact_state = 3;
  s.method = static_cast<std::uint32_t>(control::Method::kTwin);
  port_.contact.store({0, 38.9, true});
  const auto show = [&](std::uint32_t flags) {
    s.limit_flags = flags;
    ++s.tick;
    port_.samples.push(s);
    viewer_->take_samples();
    frame();
    return drawn_text(glyphs());
  };
  show(0);
  const std::string own = show(0);
  EXPECT_NE(own.find("noneletsgoat38.9nN"), std::string::npos) << own;
  show(recording::kLimitObserves);
  const std::string anothers = show(recording::kLimitObserves);
  EXPECT_NE(anothers.find("notknownhereletsgoat38.9nN"), std::string::npos) << anothers;
}

TEST_F(Guidance, GShowsAndHidesTheGuide) {
  make(1);
  play(0, 100);
  frame();
  EXPECT_FALSE(says("Firsttouch"));
  press(GLFW_KEY_G);
  EXPECT_TRUE(says("Firsttouch"));
  press(GLFW_KEY_G);
  EXPECT_FALSE(says("Firsttouch"));
}

// By its letter, wherever that lies on a keyboard; and it fits into the least window.
TEST_F(Guidance, AQuestionMarkShowsTheKeys) {
  make(1);
  play(0, 100);
  frame();
  EXPECT_FALSE(says("Keysandmouse"));
  ImGui::GetIO().AddInputCharacter('?');
  frame();
  frame();
  EXPECT_TRUE(says("Keysandmouse"));
  for (const bool mouse : {false, true}) {
    facts_.mouse_is_hand = mouse;
    make(1);
    play(0, 100);
    ImGui::GetIO().AddInputCharacter('?');
    frames(640, 480, 3);
    EXPECT_TRUE(says("Keysandmouse") && says("F1or?")) << drawn_text(glyphs());
    EXPECT_TRUE(says("guidetoafirsttouch")) << drawn_text(glyphs());
    look(mouse ? "keys_mouse" : "keys", 640, 480);
  }
}

TEST_F(Guidance, ScalesChangeByKeyAsFarAsIsSafe) {
  make(1);
  play(0, 100);
  frame();
  const double force = support::view_sample(99).force_scale;
  const double velocity = support::view_sample(99).velocity_scale;
  const auto asked = [&](int key) {
    set_modifiers(GLFW_MOD_SHIFT);
    press(key);
    set_modifiers(0);
    ViewRequest request;
    return port_.requests.pop(request) ? std::optional(request) : std::nullopt;
  };
  const auto less = asked(GLFW_KEY_DOWN);
  ASSERT_TRUE(less && less->kind == ViewRequest::Kind::kScaling);
  EXPECT_NEAR(less->scaling.force / force, std::pow(10.0, -0.1), 1e-9);
  EXPECT_DOUBLE_EQ(less->scaling.velocity, velocity);
  const auto farther = asked(GLFW_KEY_LEFT);
  ASSERT_TRUE(farther);
  EXPECT_NEAR(farther->scaling.velocity / velocity, std::pow(10.0, -0.1), 1e-9);
  // 20 is in use, and 30 is the bound.
  facts_.region.impedance_bound.fill(21);
  make(1);
  play(0, 100);
  frame();
  const auto more = asked(GLFW_KEY_UP);
  ASSERT_TRUE(more);
  EXPECT_LE(more->scaling.impedance(), 21);
  press(GLFW_KEY_UP);
  ViewRequest none;
  EXPECT_FALSE(port_.requests.pop(none)) << "without Shift";
}

TEST_F(Guidance, TheMousesHandIsLedByKeysToo) {
  facts_.mouse_is_hand = true;
  make(1);
  play(0, 100);
  frame();
  const auto hold = [&](int key, int count) {
    set_key(key, true);
    for (int i = 0; i < count; ++i) frame();
    set_key(key, false);
    frame();
  };
  hold(GLFW_KEY_DOWN, 10);
  EXPECT_DOUBLE_EQ(viewer_->hand().hand_pos_h_m().z(), 0) << "without the deadman";
  set_key(GLFW_KEY_SPACE, true);
  frame();
  hold(GLFW_KEY_DOWN, 10);
  const Vec3 down = viewer_->hand().hand_pos_h_m();
  EXPECT_LT(down.z(), 0);
  EXPECT_DOUBLE_EQ(down.x(), 0);
  hold(GLFW_KEY_RIGHT, 10);
  EXPECT_GT(viewer_->hand().hand_pos_h_m().x(), 0);
  hold(GLFW_KEY_PAGE_UP, 10);
  EXPECT_GT(viewer_->hand().hand_pos_h_m().y(), 0);
  set_key(GLFW_KEY_SPACE, false);
}

// At the tip by key; the numbers are the formula's, which the scan holds but for its pixels.
TEST_F(Guidance, AMeasurementIsShownAndWritten) {
  for (const float scale : {1.0f, 2.0f}) {
    make(scale);
    play(0, 100);
    frame();
    press(GLFW_KEY_L);
    play(3000, 6000);
    press(GLFW_KEY_L);
    play(6000, 6100);
    for (const auto& [wide, high] : {std::pair{640, 480}, {1280, 800}, {3840, 2160}}) {
      frames(wide, high, 2);
      EXPECT_EQ(overlaps(glyphs()), "") << wide << " x " << high << ", scale " << scale;
      if (scale == 1) look("measure", wide, high);
    }
  }
  frames(1280, 800, 1);
  const auto from = support::view_sample(99).tip_pos_w_nm;
  const auto to = support::view_sample(5999).tip_pos_w_nm;
  const double apart = std::hypot(to[0] - from[0], to[1] - from[1]);
  const std::string csv = viewer_->data();
  const auto number = [&](const std::string& after) {
    const auto at = csv.find(after);
    return at == std::string::npos ? std::nan("") : std::strtod(csv.c_str() + at + after.size(), nullptr);
  };
  EXPECT_NEAR(number("# distance: "), apart, 1e-3 * apart) << csv.substr(0, 300);
  EXPECT_NEAR(number("# height difference: "),
              support::view_height_nm(to[0], to[1]) - support::view_height_nm(from[0], from[1]), 0.1);
  EXPECT_TRUE(says("ProfileAtoB") && says("apart,height")) << drawn_text(glyphs());
  press(GLFW_KEY_L);
  EXPECT_FALSE(says("ProfileAtoB"));
  EXPECT_EQ(viewer_->data().find("# profile"), std::string::npos);
}

TEST_F(Guidance, CtrlAndAClickMeasuresWhereOnePointsAndDragsNothing) {
  facts_.mouse_is_hand = true;
  make(1);
  play(0, 100);
  frame();
  const auto click = [&](float x, float y) {
    ImGuiIO& io = ImGui::GetIO();
    io.MousePos = {x, y};
    set_modifiers(GLFW_MOD_CONTROL);
    frame();
    io.MouseDown[0] = true;
    frame();
    io.MousePos = {x + 20, y + 20};
    frame();
    io.MouseDown[0] = false;
    frame();
    set_modifiers(0);
  };
  click(200, 330);
  click(330, 380);
  EXPECT_TRUE(says("ProfileAtoB")) << drawn_text(glyphs());
  EXPECT_EQ(viewer_->hand().hand_pos_h_m().norm(), 0);
  EXPECT_EQ(viewer_->hand().buttons(time_s_), 0u);
}

// Of the moment when writing began. What is written is no command, but Esc.
TEST_F(Guidance, ANoteBelongsToTheMomentAtWhichItWasBegun) {
  facts_.recording = "a.h5";
  make(1);
  play(0, 100);
  frame();
  ImGuiIO& io = ImGui::GetIO();
  const auto write = [&](const std::string& text) {
    press(GLFW_KEY_N);
    frame();
    EXPECT_TRUE(says("Noteat"));
    play(100, 500);
    for (const char c : text) {
      io.AddInputCharacter(static_cast<unsigned char>(c));
      frame();
    }
  };
  write("m, r? " + std::string(100, 'x'));
  press(GLFW_KEY_M);
  press(GLFW_KEY_ENTER);
  view_model::Note note;
  ASSERT_TRUE(port_.notes.pop(note));
  EXPECT_EQ(note.tick, 99);
  EXPECT_DOUBLE_EQ(note.time_s, support::view_sample(99).time_s);
  EXPECT_EQ(std::string(note.text.data()), "m, r? " + std::string(view_model::Note::kText - 7, 'x'));
  ViewRequest request;
  EXPECT_FALSE(port_.requests.pop(request)) << "a letter was taken for a key";
  EXPECT_FALSE(says("Noteat"));
  write("");
  press(GLFW_KEY_ENTER);
  EXPECT_FALSE(port_.notes.pop(note));
  write("half");
  press(GLFW_KEY_ESCAPE);
  EXPECT_EQ(port_.stops.load(), 1u);
  EXPECT_FALSE(port_.notes.pop(note));
  EXPECT_FALSE(says("Noteat"));
}

// Before there is a session: the sample, what is waited for, and a way out; nobody is asked for anything.
TEST_F(Guidance, WhileASessionGetsReadyTheSampleIsShownAndNobodyIsAsked) {
  for (const float scale : {1.0f, 1.5f, 2.0f}) {
    make(scale);
    viewer_->wait("The server's sample is made ready here. The first time this takes some seconds.",
                  Vec3(300, 300, 40));
    for (const auto& [wide, high] : {std::pair{640, 480}, {900, 600}, {1280, 800}}) {
      frames(wide, high, 2);
      EXPECT_EQ(overlaps(glyphs()), "") << wide << " x " << high << ", scale " << scale;
      EXPECT_TRUE(says("Gettingready") && says("madereadyhere")) << drawn_text(glyphs());
      EXPECT_FALSE(says("STOP") || says("push") || says("Engaged")) << drawn_text(glyphs());
      if (scale == 1) look("waiting", wide, high);
    }
    for (const int key : {GLFW_KEY_R, GLFW_KEY_M, GLFW_KEY_1, GLFW_KEY_T, GLFW_KEY_F}) press(key);
    EXPECT_FALSE(viewer_->quit_wanted());
    press(GLFW_KEY_ESCAPE);
    EXPECT_TRUE(viewer_->quit_wanted());
  }
}

// Nothing known is not zero.
TEST_F(Guidance, BeforeTheFirstReplyNoForceIsTold) {
  make(1);
  recording::Sample s;
  s.time_s = 0.1;
  port_.samples.push(s);
  viewer_->take_samples();
  frames(1280, 800, 2);
  EXPECT_TRUE(says("NOSAMPLEYET") && says("noreplyyet")) << drawn_text(glyphs());
  EXPECT_FALSE(says("push0.00") || says("gap0.00")) << drawn_text(glyphs());
  play(1, 3);
  frames(1280, 800, 2);
  EXPECT_FALSE(says("noreplyyet"));
}

class StartScreenTest : public Guidance {
 protected:
  void SetUp() override {
    Guidance::SetUp();
    facts_.hands = {{"mouse", "mouse, in the pictures of the window", "", false},
                    {"sim", "simulated omega.3 with a simulated hand", "", true},
                    {"omega", "omega", "Force Dimension SDK not found: install it and set FDSDK", true}};
    facts_.seen = {{"lab.example.org:5100", "/home/somebody/keys/lab1.key", "flakes"},
                   {"127.0.0.1:5100", ""}};
    facts_.command_line = "telenano-master run --server lab.example.org:5100 --device sim --view";
    view_model::StartPlan plan;
    plan.scene = "flakes";
    plan.method = "twin";
    plan.safe = plan.forecast = plan.touches = true;
    plan.felt_per_nn_n = 0.019;
    facts_.plan = plan;
  }
  StartScreen::Wish draw(StartScreen& screen, int wide, int high) {
    const Canvas canvas(wide, high, 0);
    canvas.bind();
    ImGuiIO& io = ImGui::GetIO();
    io.DeltaTime = 1.0f / 30;
    return screen.draw(wide, high, facts_, choice_);
  }
  StartFacts facts_;
  view_model::StartChoice choice_;
};

TEST_F(StartScreenTest, WordsLieOnNoOthersAtAnySizeAndScale) {
  for (const float scale : {1.0f, 2.0f}) {
    for (const bool ended : {false, true}) {
      facts_.last_text.clear();
      if (ended)
        facts_.last_text = {"summary of 5.1 s", "  pull-off force                       38.87 nN",
                            "stopped by the operator"};
      choice_.record = ended;
      StartScreen screen(scale);
      for (const auto& [wide, high] : {std::pair{640, 480}, {1280, 800}, {3840, 2160}}) {
        for (int i = 0; i < 4; ++i) draw(screen, wide, high);
        EXPECT_EQ(overlaps(glyphs()), "") << wide << " x " << high << ", scale " << scale;
        // Whatever scrolls, what begins a session is in sight.
        EXPECT_TRUE(says(ended ? "Again(Enter)" : "Start(Enter)")) << drawn_text(glyphs());
        EXPECT_TRUE(says("telenano-masterrun--serverlab.example.org:5100"));
      }
    }
  }
}

// As far as the window has room for 640 x 480 points of such words.
TEST_F(StartScreenTest, WordsAreAsLargeAsAskedForAndNoneIsCut) {
  facts_.last_text = {"summary of 5.1 s", "  pull-off force                       38.87 nN",
                      "stopped by the operator"};
  StartScreen screen(1);
  const auto tallest = [&](double text_size, int wide, int high) {
    choice_.text_size = text_size;
    for (int i = 0; i < 4; ++i) draw(screen, wide, high);
    const auto drawn = glyphs();
    EXPECT_EQ(overlaps(drawn), "") << wide << " x " << high << ", text " << text_size;
    std::string cut;
    float most = 0;
    for (const Glyph& g : drawn) {
      if (g.cut) cut.push_back(g.letter < 128 ? static_cast<char>(g.letter) : '?');
      most = std::max(most, g.y1 - g.y0);
    }
    EXPECT_EQ(cut, "") << wide << " x " << high << ", text " << text_size;
    EXPECT_TRUE(says("Again(Enter)") && says("flakesatlab.example.org:5100")) << drawn_text(drawn);
    return most;
  };
  const float first = tallest(1, 1280, 960);
  EXPECT_NEAR(tallest(1.5, 1280, 960), 1.5 * first, 2);
  EXPECT_NEAR(tallest(2.5, 1280, 960), 2 * first, 2) << "twice 640 x 480";
  EXPECT_NEAR(tallest(2.5, 640, 480), first, 1);
  EXPECT_NEAR(tallest(0.75, 640, 480), 0.75 * first, 1);
}

// Which pair of keys will be used, and what the server must show: whole, in a window of the usual size.
TEST_F(StartScreenTest, TheIdentityAndTheServersKeyAreInSight) {
  StartScreen screen(1);
  for (int i = 0; i < 3; ++i) draw(screen, 1280, 800);
  EXPECT_TRUE(says("Keyfile") && !says("Server'skey")) << drawn_text(glyphs());
  choice_.identity = "omega-1.id";
  choice_.server_key = "sha256:" + std::string(64, '7');
  facts_.seen.front() = {"lab.example.org:5100", "", "flakes", "omega-1.id", choice_.server_key};
  for (int i = 0; i < 4; ++i) draw(screen, 1280, 800);
  EXPECT_EQ(overlaps(glyphs()), "");
  const std::string text = drawn_text(glyphs());
  EXPECT_TRUE(says("Identityomega-1.id") && says("Server'skey" + choice_.server_key)) << text;
  EXPECT_TRUE(says("lab.example.org:5100identityomega-1.id")) << text;
  EXPECT_FALSE(says("Keyfile")) << text;
  EXPECT_EQ(view_model::start_faults(choice_).first(), "");
  choice_.key = "lab.key";
  for (int i = 0; i < 3; ++i) draw(screen, 1280, 800);
  EXPECT_TRUE(says("Keyfilelab.key") && says("clearone")) << drawn_text(glyphs());
}

// A server with one scene leaves nothing to choose; another server's names are not kept.
TEST_F(StartScreenTest, TheSampleOfAServerWithSeveralIsInSight) {
  StartScreen screen(1);
  choice_.server = facts_.scenes_of = "lab.example.org:5100";
  for (int i = 0; i < 3; ++i) draw(screen, 1280, 800);
  EXPECT_FALSE(says("Sample")) << drawn_text(glyphs());
  facts_.scenes = {"first flakes", "flat PDMS"};
  for (int i = 0; i < 3; ++i) draw(screen, 1280, 800);
  EXPECT_TRUE(says("Samplefirstflakes")) << drawn_text(glyphs());
  EXPECT_EQ(overlaps(glyphs()), "");
  choice_.server_scene = "flat PDMS";
  for (int i = 0; i < 3; ++i) draw(screen, 1280, 800);
  EXPECT_TRUE(says("SampleflatPDMS")) << drawn_text(glyphs());
  choice_.server = "127.0.0.1:5100";
  for (int i = 0; i < 3; ++i) draw(screen, 1280, 800);
  EXPECT_FALSE(says("Sample")) << drawn_text(glyphs());
  EXPECT_EQ(choice_.server_scene, "");
}

TEST_F(StartScreenTest, EnterBeginsOnlyWhatCanBegin) {
  StartScreen screen(1);
  const auto enter = [&] {
    draw(screen, 1280, 800);
    set_key(GLFW_KEY_ENTER, true);
    const StartScreen::Wish wish = draw(screen, 1280, 800);
    set_key(GLFW_KEY_ENTER, false);
    draw(screen, 1280, 800);
    return wish;
  };
  EXPECT_EQ(enter(), StartScreen::Wish::kStart);
  choice_.server = "lab";
  EXPECT_EQ(enter(), StartScreen::Wish::kNone);
  draw(screen, 1280, 800);
  EXPECT_TRUE(says("needsitsport")) << drawn_text(glyphs());
}

TEST_F(StartScreenTest, AClickChoosesAHandAndOneThatCannotBeUsedSaysWhy) {
  StartScreen screen(1);
  draw(screen, 1280, 800);
  draw(screen, 1280, 800);
  EXPECT_TRUE(says("ForceDimensionSDKnotfound:install"));
  // Where the mouse's line stands, as it was drawn: its words begin right of its mark.
  const auto drawn = glyphs();
  const std::string text = drawn_text(drawn);
  const auto at = text.find("mouse,inthepictures");
  ASSERT_NE(at, std::string::npos);
  ImGuiIO& io = ImGui::GetIO();
  io.MousePos = {drawn[at].x0 - 12, 0.5f * (drawn[at].y0 + drawn[at].y1)};
  draw(screen, 1280, 800);
  io.MouseDown[0] = true;
  draw(screen, 1280, 800);
  io.MouseDown[0] = false;
  draw(screen, 1280, 800);
  EXPECT_EQ(choice_.device, "mouse");
}

}  // namespace
}  // namespace telenano::viewer
