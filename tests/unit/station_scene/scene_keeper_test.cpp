// A scene on its way to a station: from a server that a test plays, honest or not, through the process that
// looks at it, into the cache.
#include "telenano/master/scene/scene_keeper.h"

#include <gtest/gtest.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <unistd.h>

#include <bit>
#include <chrono>
#include <cmath>
#include <cstdlib>
#include <fstream>
#include <functional>
#include <iterator>
#include <mutex>
#include <string>
#include <vector>

#include "telenano/common/base/error.h"
#include "telenano/nve_server/scene/scene_bundle.h"
#include "telenano/nve_server/slave/canonical_motion.h"
#include "tests/source_dir.h"

namespace telenano::scene_store {
namespace {

namespace fs = std::filesystem;

const std::string kScenes = std::string(TELENANO_SOURCE_DIR) + "/deploy/scenes/";

std::string flat_with(const std::string& surface, const std::string& limits = "") {
  const std::string text =
      "name = \"a\"\n[sample]\nyoungs_modulus_gpa = 70\npoisson_ratio = 0.27\n"
      "surface_energy_j_m2 = 0.2\n[surface]\n" +
      surface +
      "\n[probe]\ntip_radius_nm = 20\nstiffness_n_m = 40\n[probe.tip]\n"
      "youngs_modulus_gpa = 160\npoisson_ratio = 0.27\nsurface_energy_j_m2 = 0.2\n[forces]\n"
      "[coupling]\nstiffness_n_m = 20\n[limits]\nforce_max_nn = 500\n" +
      limits + "\n[start]\nx_nm = 0\ny_nm = 0\nheight_nm = 20\n";
  return text;
}

std::string bundle_of(const std::string& text) {
  return scene::parse_scene_with_bundle(text, "a.toml").bundle;
}

link::SceneOffer offer_of(const std::string& bundle, std::uint64_t canonical_motion) {
  link::SceneOffer offer;
  const Sha256 hash = sha256(bundle);
  for (std::size_t i = 0; i < hash.size(); ++i) offer.hash[i / 8] |= std::uint64_t{hash[i]} << (8 * (i % 8));
  offer.bytes = static_cast<std::uint32_t>(bundle.size());
  offer.canonical_motion = canonical_motion;
  return offer;
}

class Keeper : public testing::Test {
 protected:
  void SetUp() override {
    if (!has_sha256()) GTEST_SKIP() << "built without OpenSSL";
    std::string made = (fs::temp_directory_path() / "telenano_keeper_XXXXXX").string();
    ASSERT_NE(::mkdtemp(made.data()), nullptr);
    base_ = made;
  }
  void TearDown() override {
    keeper_.reset();
    std::error_code ignored;
    if (!base_.empty()) fs::remove_all(base_, ignored);
  }
  SceneKeeperOptions options() {
    SceneKeeperOptions o;
    o.cache = base_ / "telenano";
    o.warn = o.note = [this](const std::string& line) {
      const std::lock_guard lock(mutex_);
      said_.push_back(line);
    };
    return o;
  }
  void begin(const SceneKeeperOptions& o) {
    keeper_ = std::make_unique<SceneKeeper>(o);
    keeper_->start();
  }
  void offer(const link::SceneOffer& scene) { keeper_->pipe().offer.store({scene, ++sessions_, true}); }
  /// Answers requests out of `bytes` until the keeper has settled: no duration decides but what hangs.
  void serve(const std::string& bytes, bool endless = false, const std::function<bool()>& until = {}) {
    loop::SceneAsk ask;
    loop::ScenePiece piece;
    const auto end = std::chrono::steady_clock::now() + std::chrono::seconds(120);
    const auto over = [&] { return until ? until() : keeper_->settled(); };
    while (!over() && std::chrono::steady_clock::now() < end) {
      if (const auto ground = keeper_->ground(); ground && !keeper_->scene()) early_ = ground;
      if (keeper_->news().check == SceneNews::Check::kGoesOn) look_at_slow_check();
      while (keeper_->pipe().requests.pop(ask)) {
        ++asked_;
        const std::size_t at = std::size_t{ask.chunk} * link::kSceneChunkBytes;
        if (at >= bytes.size()) continue;
        piece.bundle = ask.bundle;
        piece.chunk = ask.chunk;
        piece.size = static_cast<std::uint32_t>(std::min(bytes.size() - at, link::kSceneChunkBytes));
        std::copy_n(bytes.begin() + static_cast<std::ptrdiff_t>(at), piece.size, piece.data.begin());
        keeper_->pipe().pieces.push(piece);
      }
      // One that never stops sending what nobody asked for.
      for (int i = 0; endless && i < 64; ++i) {
        ++piece.chunk;
        keeper_->pipe().pieces.push(piece);
      }
      std::this_thread::sleep_for(std::chrono::microseconds(300));
    }
    ASSERT_TRUE(over());
  }
  /// Returns once the keeper has seen that there is another one.
  void offer_next(const std::string& bundle) {
    offer(offer_of(bundle, 1));
    while (keeper_->bundle()) std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  void look_at_slow_check() {
    for (const auto& thread : fs::directory_iterator("/proc/self/task")) {
      std::ifstream children(thread.path() / "children");
      for (int child = 0; children >> child;)
        nice_of_check_ = std::max(nice_of_check_, ::getpriority(PRIO_PROCESS, static_cast<id_t>(child)));
    }
    std::error_code none;
    kept_while_checked_ = kept_while_checked_ || fs::exists(base_ / "telenano", none);
  }
  std::vector<std::string> said() {
    const std::lock_guard lock(mutex_);
    for (const std::string& line : said_) EXPECT_EQ(line.find('\n'), std::string::npos) << line;
    return said_;
  }
  void expect_refused(const std::string& why) {
    EXPECT_FALSE(keeper_->scene());
    EXPECT_FALSE(keeper_->ground()) << "what is refused is not drawn any longer";
    const auto lines = said();
    ASSERT_EQ(lines.size(), 1u);
    EXPECT_NE(lines[0].find(why), std::string::npos) << lines[0];
    EXPECT_NE(lines[0].find("the session goes on without"), std::string::npos) << lines[0];
    EXPECT_EQ(keeper_->news().check, SceneNews::Check::kUnusable);
    EXPECT_EQ(keeper_->news().words, lines[0]) << "for the window";
  }

  fs::path base_;
  std::unique_ptr<SceneKeeper> keeper_;
  std::uint64_t sessions_ = 0;
  int asked_ = 0;
  std::shared_ptr<const surface::HeightGrid> early_;  // drawn before the scene was looked at
  int nice_of_check_ = 0;
  bool kept_while_checked_ = false;
  std::mutex mutex_;
  std::vector<std::string> said_;
};

TEST_F(Keeper, FetchesLooksAtAndKeepsAndThenAsksForNothing) {
  const auto both = scene::load_scene_with_bundle(kScenes + "flakes.toml");
  const link::SceneOffer is = offer_of(both.bundle, slave::canonical_motion_hash(both.scene));
  begin(options());
  offer(is);
  serve(both.bundle);
  ASSERT_TRUE(keeper_->scene());
  EXPECT_EQ(keeper_->scene()->bundle, both.bundle);
  EXPECT_TRUE(keeper_->scene()->same_physics);
  const CheckedScene& checked = keeper_->scene()->checked;
  EXPECT_EQ(checked.name, "flakes");
  // Fields take seconds; the heights were there before, and are the same.
  ASSERT_TRUE(early_);
  EXPECT_EQ(early_->columns, checked.ground.columns);
  EXPECT_EQ(early_->dx_nm, checked.ground.dx_nm);
  EXPECT_EQ(early_->z_nm, checked.ground.z_nm);
  EXPECT_EQ(keeper_->ground(), early_) << "no other picture";
  EXPECT_EQ(checked.scene_hash, both.scene->hash);
  // The spline goes through the heights: the picture's are those that are felt, to its rounding.
  ASSERT_EQ(checked.ground.columns, 256);
  for (const int at : {0, 77, 255}) {
    const double x = checked.ground.x_first_nm + at * checked.ground.dx_nm;
    EXPECT_NEAR(checked.ground.z_nm[static_cast<std::size_t>(256 * at + at)],
                both.scene->surface->height_nm(x, checked.ground.y_first_nm + at * checked.ground.dy_nm),
                1e-9);
  }
  // Each piece, and on a busy machine, whose answers are late, a few of them again.
  const auto chunks = static_cast<int>(is.chunks());
  EXPECT_GE(asked_, chunks);
  EXPECT_LE(asked_, chunks + chunks / 4);
  EXPECT_TRUE(said().empty());

  keeper_.reset();
  asked_ = 0;
  begin(options());
  offer(is);
  serve("");
  ASSERT_TRUE(keeper_->scene());
  EXPECT_EQ(keeper_->scene()->bundle, both.bundle);
  EXPECT_EQ(asked_, 0);
  // The same in another session: still there. Another scene: that one.
  offer(is);
  const std::string other = bundle_of(flat_with("kind = \"sphere\"\nradius_nm = 30"));
  offer(offer_of(other, 1));
  while (keeper_->scene() && keeper_->scene()->bundle == both.bundle)
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  serve(other);
  ASSERT_TRUE(keeper_->scene());
  EXPECT_EQ(keeper_->scene()->bundle, other);
  EXPECT_FALSE(keeper_->scene()->same_physics) << "1 is not what this program makes of it";
  EXPECT_FALSE(keeper_->scene()->checked.ground.z_nm.empty());
}

TEST_F(Keeper, RefusesOtherBytesThanWereNamed) {
  const std::string bundle = bundle_of(flat_with("kind = \"flat\""));
  std::string other = bundle;
  other.back() = static_cast<char>(other.back() ^ 1);
  begin(options());
  offer(offer_of(bundle, 1));
  serve(other);
  expect_refused("the announced hash");
}

TEST_F(Keeper, RefusesWhatIsTooLargeBeforeItAsks) {
  begin(options());
  link::SceneOffer offer_huge = offer_of("x", 1);
  offer_huge.bytes = UINT32_MAX;
  offer(offer_huge);
  serve("");
  EXPECT_EQ(asked_, 0);
  expect_refused("4294967295 bytes");
}

TEST_F(Keeper, GivesUpOneThatDoesNotCome) {
  SceneKeeperOptions o = options();
  o.limits.give_up_ns = 300'000'000;
  begin(o);
  offer(offer_of(bundle_of(flat_with("kind = \"flat\"")), 1));
  serve("");
  expect_refused("does not send it");
}

TEST_F(Keeper, IsNotDistractedByPiecesWithoutEnd) {
  const std::string bundle = bundle_of(flat_with("kind = \"flat\""));
  begin(options());
  offer(offer_of(bundle, 1));
  serve(bundle, true);
  ASSERT_TRUE(keeper_->scene());
  EXPECT_EQ(keeper_->scene()->bundle, bundle);
}

TEST_F(Keeper, RefusesWhatIsNoScene) {
  begin(options());
  const std::string nonsense(5000, '\xff');
  offer(offer_of(nonsense, 1));
  serve(nonsense);
  expect_refused("does not begin with");
  EXPECT_FALSE(fs::exists(base_ / "telenano")) << "kept is only what was looked at";
}

// Valid, and of as many heights as a description may ask for: 4 · 10⁶, of several numbers each.
TEST_F(Keeper, RefusesASceneThatTakesMoreMemoryThanItMay) {
  SceneKeeperOptions o = options();
  o.check_memory_bytes = std::size_t{48} << 20;
  begin(o);
  const std::string text = flat_with("kind = \"grating\"\nheight_nm = 5\nperiod_nm = 400\nspacing_nm = 1",
                                     "half_width_nm = 1000\n");
  const std::string bomb = bundle_of(text);
  ASSERT_FALSE(bomb.empty());
  offer(offer_of(bomb, 1));
  serve(bomb);
  expect_refused("do not fit into memory");
}

// 0 s: every check takes longer. It does no harm to be slow: the picture stays, and the scene arrives.
TEST_F(Keeper, ACheckThatTakesLongGoesOnAndThePictureStays) {
  const auto both = scene::load_scene_with_bundle(kScenes + "flakes_potential.toml");
  SceneKeeperOptions o = options();
  o.check_seconds = 0;
  begin(o);
  offer(offer_of(both.bundle, slave::canonical_motion_hash(both.scene)));
  serve(both.bundle);
  EXPECT_EQ(nice_of_check_, 19) << "behind all else";
  EXPECT_TRUE(kept_while_checked_) << "what was fetched is kept";
  ASSERT_TRUE(early_);
  EXPECT_EQ(keeper_->ground(), early_) << "no other picture";
  ASSERT_TRUE(keeper_->scene());
  EXPECT_TRUE(keeper_->scene()->same_physics);
  EXPECT_EQ(keeper_->news().check, SceneNews::Check::kQuiet);
  EXPECT_EQ(keeper_->news().words, "");
  const auto lines = said();
  ASSERT_EQ(lines.size(), 2u);
  EXPECT_NE(lines[0].find("the check goes on"), std::string::npos) << lines[0];
  EXPECT_EQ(lines[0].find("damaged"), std::string::npos) << lines[0];
  EXPECT_NE(lines[1].find("is checked now"), std::string::npos) << lines[1];
}

// A grating of so many heights a side: fields of 1000² take half a minute of a processor.
std::string grating(int side, const char* tip_radius = "20") {
  std::string text = flat_with("kind = \"grating\"\nheight_nm = 5\nperiod_nm = 400\nspacing_nm = 1",
                               "half_width_nm = " + std::to_string(side / 2) + "\n");
  return bundle_of(text.replace(text.find("tip_radius_nm = 20") + 16, 2, tip_radius));
}

TEST_F(Keeper, EndsACheckThatFindsNoEndAndStillChecksTheNextScene) {
  SceneKeeperOptions o = options();
  o.check_seconds = 0;
  o.check_most_seconds = 1;
  begin(o);
  const std::string slow = grating(800);
  offer(offer_of(slow, 1));
  serve(slow);
  EXPECT_FALSE(keeper_->scene());
  ASSERT_EQ(said().size(), 2u);
  EXPECT_NE(said()[1].find("found no end over it in 1 s"), std::string::npos) << said()[1];
  EXPECT_EQ(said()[1].find("damaged"), std::string::npos) << "slow is not damaged: " << said()[1];
  const std::string next = bundle_of(flat_with("kind = \"flat\""));
  offer_next(next);
  serve(next);
  ASSERT_TRUE(keeper_->scene());
  EXPECT_EQ(keeper_->scene()->bundle, next);
}

// Nobody waits for the sample that was left.
TEST_F(Keeper, AnotherSceneEndsACheckThatGoesOn) {
  SceneKeeperOptions o = options();
  o.check_seconds = 0;
  begin(o);
  const std::string slow = grating(600);
  offer(offer_of(slow, 1));
  serve(slow, false, [&] { return keeper_->news().check == SceneNews::Check::kGoesOn; });
  const std::string next = bundle_of(flat_with("kind = \"flat\""));
  offer_next(next);
  serve(next);
  ASSERT_TRUE(keeper_->scene());
  EXPECT_EQ(keeper_->scene()->bundle, next);
  int went_on = 0;
  int ended = 0;
  for (const std::string& line : said()) {
    EXPECT_EQ(line.find("cannot be used"), std::string::npos) << line;
    went_on += line.find("goes on") != std::string::npos ? 1 : 0;
    ended += line.find("is checked now") != std::string::npos ? 1 : 0;
  }
  EXPECT_LT(ended, went_on) << "the first was left, not waited for";
}

// Drawn as large as it is, from the first picture on.
TEST_F(Keeper, TheTipsRadiusIsThatOfTheScene) {
  SceneKeeperOptions o = options();
  o.check_seconds = 0;
  begin(o);
  const std::string slow = grating(400, "10");
  offer(offer_of(slow, 1));
  serve(slow, false, [&] {
    return keeper_->news().check == SceneNews::Check::kGoesOn && keeper_->news().tip_radius_nm > 0;
  });
  EXPECT_EQ(keeper_->news().tip_radius_nm, 10) << "of its description, before anything is made of it";
  const std::string flat = bundle_of(flat_with("kind = \"flat\""));
  offer_next(flat);
  serve(flat);
  EXPECT_EQ(keeper_->news().tip_radius_nm, 20);
  keeper_.reset();
  begin(options());
  offer(offer_of(flat, 1));
  serve("");
  EXPECT_EQ(keeper_->news().tip_radius_nm, 20) << "of what was found before";
}

// Looking at a scan takes seconds. What was found is kept: a second look, which would not end in its second
// here, is not needed. What is wrong in the file of the finding is looked at anew.
// Whoever looks writes down what was found, in a new file: so it is seen whether anybody has looked.
TEST_F(Keeper, LooksOnceAtASceneThatItKeeps) {
  const auto both = scene::load_scene_with_bundle(kScenes + "flakes_potential.toml");
  const link::SceneOffer is = offer_of(both.bundle, slave::canonical_motion_hash(both.scene));
  const auto begin_again = [&] {
    keeper_.reset();
    asked_ = 0;
    begin(options());
    offer(is);
    serve("");
    EXPECT_EQ(asked_, 0);
    EXPECT_TRUE(said().empty());
  };
  begin(options());
  offer(is);
  serve(both.bundle);
  ASSERT_TRUE(keeper_->scene());
  const CheckedScene first = keeper_->scene()->checked;
  std::vector<fs::path> findings;
  for (const auto& entry : fs::directory_iterator(base_ / "telenano"))
    if (entry.path().filename().string().find('-') != std::string::npos) findings.push_back(entry.path());
  ASSERT_EQ(findings.size(), 1u);
  const auto read = [&] {
    std::ifstream in(findings[0], std::ios::binary);
    return std::string(std::istreambuf_iterator<char>(in), {});
  };
  const std::string found = read();
  const auto file_number = [&] {
    struct stat status {};
    EXPECT_EQ(::stat(findings[0].c_str(), &status), 0);
    return status.st_ino;
  };
  const auto before = file_number();

  begin_again();
  ASSERT_TRUE(keeper_->scene());
  EXPECT_TRUE(keeper_->scene()->same_physics);
  EXPECT_EQ(keeper_->scene()->checked.ground.z_nm, first.ground.z_nm);
  EXPECT_EQ(keeper_->scene()->checked.scene_hash, first.scene_hash);
  EXPECT_EQ(file_number(), before) << "nobody has looked";

  {
    std::fstream file(findings[0], std::ios::in | std::ios::out | std::ios::binary);
    file.seekp(100);
    file.put(static_cast<char>(found[100] ^ 1));
  }
  ASSERT_NE(read(), found);
  begin_again();
  ASSERT_TRUE(keeper_->scene());
  EXPECT_EQ(keeper_->scene()->checked.ground.z_nm, first.ground.z_nm);
  EXPECT_EQ(read(), found) << "what was damaged is not believed";
  EXPECT_NE(file_number(), before);
}

// A session may end while its scene is still looked at, which may take a minute.
TEST_F(Keeper, EndsAtOnceThoughItStillLooks) {
  begin(options());
  // Fields of 1000² heights: half a minute.
  const std::string slow = bundle_of(flat_with(
      "kind = \"grating\"\nheight_nm = 5\nperiod_nm = 400\nspacing_nm = 1", "half_width_nm = 500\n"));
  offer(offer_of(slow, 1));
  loop::SceneAsk ask;
  for (std::size_t asked = 0; asked < offer_of(slow, 1).chunks();) {
    while (keeper_->pipe().requests.pop(ask)) {
      loop::ScenePiece piece;
      piece.bundle = ask.bundle;
      piece.chunk = ask.chunk;
      const std::size_t at = std::size_t{ask.chunk} * link::kSceneChunkBytes;
      piece.size = static_cast<std::uint32_t>(std::min(slow.size() - at, link::kSceneChunkBytes));
      std::copy_n(slow.begin() + static_cast<std::ptrdiff_t>(at), piece.size, piece.data.begin());
      keeper_->pipe().pieces.push(piece);
      ++asked;
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  while (!keeper_->bundle()) std::this_thread::sleep_for(std::chrono::milliseconds(1));
  ASSERT_FALSE(keeper_->settled());
  const auto begin = std::chrono::steady_clock::now();
  keeper_.reset();
  const std::chrono::duration<double> spent = std::chrono::steady_clock::now() - begin;
  EXPECT_LT(spent.count(), 5);
  EXPECT_TRUE(said().empty()) << "nobody's fault";
}

TEST_F(Keeper, RefusesATextThatSaysOtherThanTheNumbers) {
  std::string bundle = bundle_of(flat_with("kind = \"flat\""));
  const std::size_t at = bundle.find("force_max_nn = 500");
  ASSERT_NE(at, std::string::npos);
  bundle.replace(at, 18, "force_max_nn = 100");
  begin(options());
  offer(offer_of(bundle, 1));
  serve(bundle);
  expect_refused("its text and its numbers differ");
}

}  // namespace
}  // namespace telenano::scene_store
